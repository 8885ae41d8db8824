#include "libport/taped/tape_news.hpp"

#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/taped/ending_tapes.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// A nearly full disk takes one block and not the next: how often that is told.
constexpr Nanos kTellingEvery = seconds(1);
// After which silence of the disk it is told of; fail_closed ends the line within two seconds.
constexpr Nanos kSilence = seconds(1);
constexpr Nanos kFailClosedSilence = milliseconds(700);

}  // namespace

TapeNews::Found TapeNews::look(const LiveTape::Status& status) {
  Found found;
  if (status.phase != LiveTape::Status::Phase::being_made && !std::exchange(told_.made, true)) {
    context_.log->info("recording to {}", status.paths.name());
    found.made = true;
  }
  if (status.slowest >= LiveTape::kLongWrite && !std::exchange(told_.slow, true)) {
    context_.log->warn(
        "tape {}: its disk took {} ms for a write; what is recorded goes over a queue from now on", tape_,
        status.slowest.count());
  }
  if (status.sync_error != 0 && !std::exchange(told_.sync, true)) {
    context_.log->error("{}", sync_error_text(status));
    found.sync_failed = found.fails = true;
  }
  if (status.failure.empty() == told_.failing && failure(status)) found.fails = true;
  return found;
}

bool TapeNews::failure(const LiveTape::Status& status) {
  told_.failing = !status.failure.empty();
  if (!told_.failing) {
    if (std::exchange(told_.failure, false))
      context_.log->info("{} is being written again; {} bytes are missing", tape_, status.bytes_lost);
    return false;
  }
  const Instant now = context_.loop->now();
  if (now < next_telling_) return false;
  next_telling_ = now + kTellingEvery;
  told_.failure = true;
  context_.log->error(
      "tape {}: {}; {}", tape_, status.failure,
      fail_closed_ ? "ending, as --fail-closed asks" : "the line stays up, the loss is counted");
  return true;
}

bool TapeNews::silence(const LiveTape::Status& status) {
  const Nanos silence = status.silence.value_or(Nanos{});
  if (silence >= kSilence && !std::exchange(told_.silence, true)) {
    context_.log->error("tape {}: its disk does not answer; {} bytes wait for it", tape_,
                        status.bytes_waiting);
  }
  return silence >= kFailClosedSilence;
}

}  // namespace porttape
