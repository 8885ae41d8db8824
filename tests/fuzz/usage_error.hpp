#pragma once

#include <algorithm>
#include <string>

#include "libport/base/error.hpp"
#include "libport/base/printable.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace porttape::test {

// What an error of the user's own text must be: Errc::usage, and one line as a person is shown it.
inline void require_usage(const Error& error) {
  require(error.code == Errc::usage, "what a user wrote wrong is a usage error");
  require(!error.message.empty(), "an error says what is wrong");
  const std::string shown = printable_line(error.message);
  const auto obeyed = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; };
  require(std::none_of(shown.begin(), shown.end(), obeyed), "an error is shown in one printable line");
}

}  // namespace porttape::test
