#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <utility>

#include "libport/port/context.hpp"
#include "libport/tape/live_tape.hpp"

namespace porttape {

// Tapes that are being finished, while the line goes on or ends: says in the log how each of them ends, and
// when all have. Owns them. For an observer that writes tapes; it makes each with news(). Loop thread only.
class EndingTapes {
 public:
  // `on_news`: a tape made with news() has some; comes on the loop. `on_sync_error`: what was written of one
  // that ends may not be on the disk.
  // `on_ended`: one that was made is complete, or as complete as it will be.
  explicit EndingTapes(const PortContext& context, std::function<void()> on_news = {},
                       std::function<void()> on_sync_error = {},
                       std::function<void(const TapePaths&)> on_ended = {});
  ~EndingTapes();
  EndingTapes(const EndingTapes&) = delete;
  EndingTapes& operator=(const EndingTapes&) = delete;

  // LiveTape::Options::on_news of a tape that will be finished here.
  [[nodiscard]] std::function<void()> news();

  struct Known {
    bool sync_error_told = false;    // the log has it already
    std::uint64_t missed_bytes = 0;  // that passed before it, and that it was to tell of
  };
  // Finishes it at `at`.
  void finish(std::unique_ptr<LiveTape> tape, TapeTime at) { finish(std::move(tape), at, Known{}); }
  void finish(std::unique_ptr<LiveTape> tape, TapeTime at, Known known);
  // `done` comes once none is left, from within or later: with whether everything is on them.
  void when_over(std::function<void(bool complete)> done);
  // Waits for none of them any more, says what is missing, and does not call `done`.
  void give_up();

 private:
  struct Ending;

  void look();
  bool is_over(Ending& ending);

  PortContext context_;
  std::function<void()> on_news_;
  std::function<void()> on_sync_error_;
  std::function<void(const TapePaths&)> on_ended_;
  std::list<Ending> tapes_;
  bool complete_ = true;
  std::function<void(bool)> on_done_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

// For the log: bytes that no tape has. 0: only why.
std::string missed_text(std::uint64_t bytes, const std::string& why);
// And: `status` has a sync error.
std::string sync_error_text(const LiveTape::Status& status);

}  // namespace porttape
