#include "libport/taped/ending_tapes.hpp"

#include <cerrno>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {

struct EndingTapes::Ending {
  std::unique_ptr<LiveTape> tape;
  Known known;
};

EndingTapes::EndingTapes(const PortContext& context, std::function<void()> on_news,
                         std::function<void()> on_sync_error, std::function<void(const TapePaths&)> on_ended)
    : context_(context),
      on_news_(std::move(on_news)),
      on_sync_error_(std::move(on_sync_error)),
      on_ended_(std::move(on_ended)) {}

EndingTapes::~EndingTapes() = default;

std::function<void()> EndingTapes::news() {
  return [post = context_.loop->poster(), this, alive = std::weak_ptr<int>(alive_)] {
    post([this, alive] {
      if (alive.expired()) return;
      if (on_news_) on_news_();
      look();
    });
  };
}

void EndingTapes::finish(std::unique_ptr<LiveTape> tape, TapeTime at, Known known) {
  tape->finish(at);
  tapes_.push_back({std::move(tape), known});
}

void EndingTapes::when_over(std::function<void(bool)> done) {
  on_done_ = std::move(done);
  look();
}

void EndingTapes::look() {
  std::erase_if(tapes_, [this](Ending& ending) { return is_over(ending); });
  if (tapes_.empty() && on_done_) std::exchange(on_done_, {})(complete_);
}

bool EndingTapes::is_over(Ending& ending) {
  const LiveTape::Status status = ending.tape->status();
  if (status.sync_error != 0 && !std::exchange(ending.known.sync_error_told, true)) {
    complete_ = false;
    context_.log->error("{}", sync_error_text(status));
    if (on_sync_error_) on_sync_error_();
  }
  if (!status.over()) return false;
  if (on_ended_ && status.phase == LiveTape::Status::Phase::finished) on_ended_(status.paths);
  if (!status.error) {
    context_.log->info("{} is complete: {} bytes", status.paths.name(), status.bytes_written);
    return true;
  }
  complete_ = false;
  if (status.phase == LiveTape::Status::Phase::not_made) {
    context_.log->error("{}",
                        missed_text(status.bytes_lost + ending.known.missed_bytes, status.error->message));
  } else {
    context_.log->error("{}", status.error->message);
  }
  return true;
}

void EndingTapes::give_up() {
  on_done_ = {};
  for (const Ending& ending : tapes_) {
    const LiveTape::Status status = ending.tape->status();
    context_.log->error("tape {}: its disk did not answer in time; {} bytes and the end are not on it",
                        status.paths.name(),
                        status.bytes_waiting + status.bytes_lost + ending.known.missed_bytes);
  }
  tapes_.clear();
}

std::string missed_text(std::uint64_t bytes, const std::string& why) {
  return bytes == 0 ? why : fmt::format("{} bytes passed and are on no tape: {}", bytes, why);
}

std::string sync_error_text(const LiveTape::Status& status) {
  return fmt::format("tape {}: what was written may not be on the disk: {}", status.paths.name(),
                     status.sync_error == ENOENT ? "its files were removed; SIGUSR1 begins the next tape"
                                                 : errno_text(status.sync_error));
}

}  // namespace porttape
