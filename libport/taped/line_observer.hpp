#pragma once

#include <functional>
#include <optional>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/port/port.hpp"
#include "libport/tape/event.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// Is told what passes a line, in order and stamped, after it was passed on: the keeper of a tape, one who
// shows it, one who counts. Changes nothing, and never makes the line wait. Loop thread only.
class LineObserver {
 public:
  virtual ~LineObserver() = default;

  // Before the line is there: whether it can do its work. Errc::usage.
  [[nodiscard]] virtual Result<void> check() const = 0;

  // A driver opened and closed the line; between them the line came up, if the device is there.
  virtual void opened(Instant at) = 0;
  virtual void came_up(Instant at) = 0;
  virtual void closed(Instant at) = 0;

  // As Direction has it: `read` is what the device sent. Never empty; valid during the call.
  virtual void block(Direction direction, Instant at, ByteView data) = 0;
  // An event, in its place among the blocks.
  virtual void note(Instant at, const Event& event) = 0;

  // A user asks for something. False: it is not for this observer. Errc::usage: it cannot be done now.
  virtual Result<bool> request(Instant at, const RecorderRequest& what) = 0;
  // How the tape stands that it keeps, if it does.
  [[nodiscard]] virtual std::optional<RecordingStatus> recording() const { return std::nullopt; }
  // The last call but for give_up(): completes its work. `done` comes once, from within or later: with
  // whether it has kept everything that passed.
  virtual void finish(Instant at, std::function<void(bool complete)> done) = 0;
  // finish() takes too long, or will not come any more: says what is missing, and does not call `done`. It is
  // destroyed next, or soon.
  virtual void give_up() = 0;
};

}  // namespace porttape
