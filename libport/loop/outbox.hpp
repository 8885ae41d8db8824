#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/loop/fd_watch.hpp"

namespace porttape {

// The sending half of a stream descriptor: writes at once what the kernel takes and keeps the rest. Events
// can be put among the bytes; each is called at its place. Bytes and events are bounded by the outbox's
// users, who stop writing while congested() and put only events that somebody waits for. A write error is
// reported with the number of bytes that it cost; no on_drained comes after it until discard() makes a new
// beginning. What the kernel has no memory for waits. Loop thread only.
class Outbox {
 public:
  enum class Kind { file, socket };  // of the descriptor; a socket whose peer is gone must not raise SIGPIPE

  // What has become of an event.
  enum class Turn {
    now,   // the kernel has taken all bytes that were written before it: it is to happen now
    never  // discard() or a write error has dropped it: it is not to happen any more
  };
  // Does what the event stands for, and returns whether that is done. If the kernel has no room for what the
  // event sends, it returns false, without having called the outbox; it is called again when there is room.
  // A line on which its own sending fails for good breaks at the next write or read: it is done then. The
  // result for Turn::never does not matter.
  using Event = std::function<bool(Turn)>;

  // `watch` must call flush() when writable; it and `fd` must outlive the outbox.
  Outbox(int fd, Kind kind, FdWatch& watch, std::function<void()> on_drained,
         std::function<void(int error_number, std::size_t lost)> on_error);

  void write(ByteView data);
  // Sends what the kernel takes and keeps nothing; on_drained comes when it takes more.
  std::size_t write_some(ByteView data);
  // Puts an event behind all bytes that were taken and before those that will be; what write_some() did not
  // take comes behind it. The event is called until it is done, or once with Turn::never: from within put()
  // if nothing waits or after a write error, else from within flush() or discard(). It may call the outbox.
  void put(Event event);
  void flush();    // from the watch
  void discard();  // also a new beginning after an error
  // Whether bytes or events wait.
  [[nodiscard]] bool congested() const { return sent_ < pending_.size() || !events_.empty(); }
  [[nodiscard]] std::size_t pending() const { return pending_.size() - sent_; }

 private:
  struct Sent {
    std::size_t bytes = 0;
    int error = 0;  // what broke the line
  };
  struct WaitingEvent {
    std::size_t place;  // in pending_
    Event event;
  };

  // Sends `data`; less than all when the kernel is full or the line is broken.
  [[nodiscard]] Sent send(ByteView data) const;
  bool call_next_event();
  void wait();
  // Forgets all that waits and returns the events among it, which the caller tells of that.
  std::vector<WaitingEvent> forget_pending();
  void fail(int error_number, std::size_t lost);

  int fd_;
  Kind kind_;
  FdWatch* watch_;
  std::function<void()> on_drained_;
  std::function<void(int, std::size_t)> on_error_;
  Bytes pending_;
  std::size_t sent_ = 0;
  std::vector<WaitingEvent> events_;
  bool owes_drained_ = false;
  bool broken_ = false;
};

}  // namespace porttape
