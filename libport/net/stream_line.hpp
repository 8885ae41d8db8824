#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/base/end_wait.hpp"
#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/line/line_event.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/timer.hpp"
#include "libport/net/tcp_peer.hpp"
#include "libport/port/port.hpp"

namespace porttape {

// Whether the peer of a connected stream socket sends no more: it has ended that, closed or reset.
bool has_ended(int fd);

// One connection of a stream socket, from its first byte to its end: carries its bytes, and finds out when it
// is over, however its peer leaves. Owns the descriptor.
//
// | phase       | what it means                             | over when                                |
// |-------------|-------------------------------------------|------------------------------------------|
// | up          | bytes go both ways                        | it breaks; the peer ends it and nobody   |
// |             |                                           | wants to answer; not read: see below     |
// | half_closed | the peer sends no more; it may still read | it is seen to be gone, or quiet for long |
// | sending     | hung up: what is queued goes out first    | it breaks, or the peer is gone           |
// | leaving     | hung up: waits for the peer's close       | the peer closes, or 2 s later            |
// | over        | close() was called                        |                                          |
//
// While an accepted line is up and not read, its peer's end is looked for: it is over when the peer is gone
// and has left nothing, or nobody wants what it left, or 10 s later.
//
// Drive it: set_reading(), then read and write until Owner::line_over(), hang_up() or the owner's own end;
// then close(), after which the owner is not called. Since close() may come from within a call of the owner,
// the line is to be destroyed on a later turn of the loop.
class StreamLine {
 public:
  // Who has the line. Called from the loop, and from within read_pending(), write() (dropped alone),
  // drop_unsent() (line_told alone) and close() (these two alone).
  class Owner {
   public:
    virtual void line_data(ByteView data) = 0;
    virtual void line_drained() = 0;
    // What the line has seen, at its place among the bytes, or the answer to a request that tell() took.
    virtual void line_told(const LineEvent& event) = 0;
    virtual PortListener::Answers line_ended() = 0;    // see PortListener::on_ended
    virtual void line_over(const LineDown& down) = 0;  // to be closed now
    virtual void dropped(std::uint64_t bytes, const char* why) = 0;
    [[nodiscard]] virtual bool wants_rest() = 0;  // see PortListener::wants_rest
    // See PortListener::unread.
    [[nodiscard]] virtual std::optional<std::size_t> unread_elsewhere() = 0;
    [[nodiscard]] virtual PeerState look_at_peer(int fd) = 0;
    [[nodiscard]] virtual bool next_waits() = 0;  // another peer, for this one to make room

   protected:
    ~Owner() = default;
  };

  // Who made the connection: an accepted peer's death is noticed while it is not read, too.
  enum class Side { connected, accepted };

  // `name` is for messages; `loop` and `owner` must outlive the line.
  StreamLine(Loop& loop, Owner& owner, Side side, std::string name, UniqueFd fd);
  StreamLine(const StreamLine&) = delete;
  StreamLine& operator=(const StreamLine&) = delete;

  // Whether write() still reaches the peer.
  [[nodiscard]] bool takes() const { return phase_ < Phase::sending && !end_wanted_; }
  void write(ByteView data);
  std::size_t write_some(ByteView data);
  // Takes an event for its place behind all that was written; StreamPort passes on each that it is told.
  // False: events of that kind do nothing on this line, or (a drain) need not wait, since nothing is to be
  // sent; then the caller answers a request. One that was taken is answered once, also where what it waits
  // for is dropped.
  bool tell(const LineEvent& event);
  [[nodiscard]] bool congested() const { return outbox_.congested(); }
  // Bytes that have not left this machine.
  [[nodiscard]] std::size_t unsent() const;
  // Drops what waits to be sent and gives how much that was.
  std::size_t drop_unsent();
  void end_writing();

  void set_reading(bool on);
  void read_pending();
  [[nodiscard]] bool left_bytes() const;  // see Port::left_bytes
  // Takes what has come so far and gives how much that was; what the kernel has taken is on its way.
  std::uint64_t read_away();

  // Whether the peer is at the line's other end still: it has not ended it, and was not hung up.
  [[nodiscard]] bool has_peer() const;
  // Where the peer has ended the line: reads what it left and comes to that end, as far as reading is on.
  void catch_up();

  // True: line_over() follows. False: nothing is left to wait for, and it can be closed.
  bool hang_up(bool after_reading);
  [[nodiscard]] bool hangs_up_when_sent() const { return phase_ == Phase::sending; }
  // Orderly: FIN after the bytes. Otherwise the peer sees a reset.
  void close(bool orderly);

 private:
  enum class Phase { up, half_closed, sending, leaving, over };

  void on_readable();
  void received(ByteView data);
  void peer_ended();
  void tell_closed();
  void broken(int error_number);
  void on_drained();
  void on_timer();
  void watch_reading();
  void watch_half_closed();
  void watch_unread();
  [[nodiscard]] std::size_t unread() const;

  Loop* loop_;
  Owner* owner_;
  const Side side_;
  const std::string name_;
  UniqueFd fd_;
  FdWatch watch_;
  Outbox outbox_;
  Timer timer_;
  Phase phase_ = Phase::up;
  bool reading_ = true;
  bool end_wanted_ = false;  // end_writing() was called
  bool quiet_ends_ = false;  // half_closed: the peer counts as gone when nothing was written for a while
  Instant since_{};          // half_closed: the last write
  std::optional<EndWait> rest_wait_;                      // not read, and seen to be gone
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
