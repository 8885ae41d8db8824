#include "tools/progress.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <iostream>
#include <limits>
#include <unistd.h>
#include <utility>

#include "tools/text.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kLookEvery = std::uint64_t{1} << 18U;  // bytes
constexpr Nanos kSilent = std::chrono::seconds(1);
constexpr Nanos kShowEvery = std::chrono::milliseconds(200);

}  // namespace

Progress::Progress(std::ostream& err, std::string_view verb, std::uint64_t total_bytes)
    : err_(err), verb_(verb), total_(total_bytes), begun_(verb_clock().now()), shown_at_(begun_) {
  const bool shows = &err == &std::cerr && ::isatty(STDERR_FILENO) == 1;
  look_at_ = shows ? kLookEvery : std::numeric_limits<std::uint64_t>::max();
}

void Progress::look(std::uint64_t bytes) {
  look_at_ = bytes + kLookEvery;
  const Instant now = verb_clock().now();
  if (now - begun_ < kSilent || now - shown_at_ < kShowEvery) return;
  shown_at_ = now;
  shown_ = true;
  const std::uint64_t percent =
      total_ == 0 ? 0 : std::min<std::uint64_t>(bytes / std::max<std::uint64_t>(total_ / 100, 1), 100);
  const auto us = std::chrono::duration_cast<Micros>(now - begun_).count();
  err_ << fmt::format("\rporttape {}: {} % of {} MB, {} \033[K", verb_, percent, total_ / 1'000'000,
                      rate_text(bytes, us))
       << std::flush;
}

void Progress::clear() {
  if (std::exchange(shown_, false)) err_ << "\r\033[K" << std::flush;
}

}  // namespace porttape
