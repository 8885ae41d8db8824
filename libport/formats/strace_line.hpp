#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"

namespace porttape {

// A system call, as strace prints it (strace(1)).
struct StraceCall {
  std::uint32_t thread = 0;  // 0: strace followed only one
  std::int64_t begin_us = 0;
  std::optional<std::int64_t> end_us;  // where it is told (-T), or others ran meanwhile (-f)
  std::string name;
  std::string args;  // what stands between the parentheses
  std::optional<std::int64_t> result;
  std::string error;         // "EAGAIN", of a result -1
  bool interrupted = false;  // others ran meanwhile
};
// A thread has ended.
struct StraceEnd {
  std::uint32_t thread = 0;
};

// Reads strace's lines, in their order, and joins the two halves of calls that others interrupted. Times are
// those of -ttt, -tt and -t, or of -r, added up; of a day's clock midnight is seen. Without times
// each line is a microsecond later, so that their order stays. A value.
class StraceLines {
 public:
  struct Line {
    std::optional<StraceCall> call;
    std::optional<StraceEnd> end;
    bool understood = false;  // it is one of strace's
  };
  Line read(std::string_view text);

  // Some line had a time; of the last one, in microseconds since 1970 with -ttt.
  [[nodiscard]] bool has_times() const { return clock_ != Clock::none; }
  [[nodiscard]] bool has_dates() const { return clock_ == Clock::date; }

 private:
  enum class Clock { none, date, day, relative };
  void take_time(std::string_view& text);
  Line read_call(std::string_view text, std::uint32_t thread);

  Clock clock_ = Clock::none;
  std::int64_t now_us_ = 0;
  std::int64_t midnights_us_ = 0;
  std::map<std::uint32_t, StraceCall> unfinished_;
};

// Strings in a call's arguments, in their order, bytes as they were; `cut` where strace printed only the
// beginning (-s).
struct StraceString {
  Bytes bytes;
  bool cut = false;
};
std::vector<StraceString> strace_strings(std::string_view args);
// The number in front: a file descriptor, whatever -y says behind it.
std::optional<int> strace_number(std::string_view args);
// What stands behind the N-th comma that is outside of quotes, brackets and the like; empty: it is not there.
std::string_view strace_argument(std::string_view args, std::size_t n);

}  // namespace porttape
