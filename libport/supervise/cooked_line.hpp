#pragma once

#include <algorithm>
#include <string_view>
#include <termios.h>

#include "libport/base/bytes.hpp"

namespace porttape {

// A tty's settings may change the bytes that a program writes, or echo the bytes that come. Each function
// returns the first such setting that concerns `data`, as stty(1) names it, or an empty text. Source:
// termios(3), c_oflag and ECHO.
inline std::string_view changed_when_written(const termios& line, ByteView data) {
  const tcflag_t flags = line.c_oflag;
  if ((flags & OPOST) == 0) return {};
  const auto has = [&](char which) { return std::ranges::find(as_text(data), which) != as_text(data).end(); };
  if ((flags & ONLCR) != 0 && has('\n')) return "onlcr";
  if ((flags & OCRNL) != 0 && has('\r')) return "ocrnl";
  if ((flags & ONOCR) != 0 && has('\r')) return "onocr";
  if ((flags & TABDLY) == XTABS && has('\t')) return "tab3";
  const auto is_small = [](char each) { return each >= 'a' && each <= 'z'; };
  if ((flags & OLCUC) != 0 && std::ranges::any_of(as_text(data), is_small)) return "olcuc";
  return {};
}
inline std::string_view sent_back_when_read(const termios& line, ByteView data) {
  return (line.c_lflag & ECHO) != 0 && !data.empty() ? "echo" : "";
}

}  // namespace porttape
