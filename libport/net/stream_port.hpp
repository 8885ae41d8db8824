#pragma once

#include <memory>
#include <optional>
#include <string>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/timer.hpp"
#include "libport/net/connector.hpp"
#include "libport/net/tcp_peer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {

// What TCP and Unix stream sockets have alike.
struct StreamOptions {
  bool listen = false;
  bool wait = false;  // for a peer that is missing, instead of failing
};

// A stream socket, TCP or Unix: what both do alike. Either connects at each open(), or (`listen`) waits for
// peers and is passive.
//
// Listening: one peer at a time; the next ones wait in the backlog. A peer that has only ended its sending
// direction is kept while the listener wants that (on_ended), at most until it is seen to be gone. Where
// nobody will say which answer is the last, it is kept until nothing was written to it for two seconds; when
// another one waits and it is on another machine, where a half-close looks like a close, a tenth of a second,
// or two seconds if somebody will say. A peer that dies while it is not read is noticed, and kept for 10 s if
// its bytes are wanted (wants_rest).
//
// Connecting: `timeout` is the limit when positive, else ten seconds. `wait` tries a peer that is missing
// again and again, after 100 ms, 200 ms, … 5 s. `alwaysopen` connects in prepare(), keeps the connection
// through close(), and makes a new one when it drops.
//
// Where the kernel does not tell whether a peer is gone (sock_diag is refused, say), it is taken for a
// half-closed one and nobody's arrival cuts it short; the log says so once.
//
// Closing is orderly (FIN after the bytes); hang_up(false) resets. What was not sent or not read is told by
// on_dropped.
class StreamPort : public Port, private WaitingCalls {
 public:
  ~StreamPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_ && line_->outbox.congested(); }
  // Once a TCP peer's machine has them all it counts as read.
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  [[nodiscard]] WaitingCalls* waiting() override { return this; }
  [[nodiscard]] bool keeps_datagrams() const override { return false; }
  bool end_writing() override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] bool passive() const override { return stream_.listen; }

 protected:
  StreamPort(const PortContext& context, const CommonOptions& common, StreamOptions options);

  // What the kinds of sockets do differently. A listening socket, bound; Errc::usage or Errc::io.
  virtual Result<UniqueFd> make_listener() = 0;
  virtual Result<void> check_peer() { return {}; }  // before the first connection, without making one
  virtual void connect_to_peer(Connector& connector) = 0;
  virtual void set_up(int fd) { (void)fd; }
  virtual PeerState peer_state(int fd) const = 0;  // asked by look_at_peer() alone

  PortContext context_;

 private:
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() override { return *unread_by_peer(); }
  bool discard() override;
  [[nodiscard]] std::string awaits() override { return {}; }

  enum class Phase {
    up,
    half_closed,  // the peer sends no more; it may still read
    sending,      // hung up: what is queued goes out first
    leaving       // hung up: waits for the peer's close
  };

  // What belongs to one connection and goes with it.
  struct Line {
    Line(StreamPort& port, UniqueFd connected);
    UniqueFd fd;
    FdWatch watch;
    Outbox outbox;
    Phase phase = Phase::up;
    bool end_wanted = false;  // end_writing() was called
    bool quiet_ends = false;  // half_closed: the peer counts as gone when nothing was written for a while
    Instant since{};          // half_closed: the last write
    std::optional<Instant> gone_since;  // not read, and seen to be gone
  };

  void connect();
  void connected(Result<UniqueFd> result);
  void on_acceptable();
  void begin_line(UniqueFd fd);
  void on_readable();
  void received(ByteView data);
  void peer_ended();
  PeerState look_at_peer(int fd);
  void on_drained();
  void on_line_timer();
  void watch_half_closed();
  void watch_unread();
  void watch_reading();
  void line_broken(int error_number);
  void finish_line(const LineDown& down);
  void drop_line(bool orderly);
  static std::size_t unread(int fd);
  std::uint64_t read_away(int fd);
  void drop(std::uint64_t bytes, const char* why);
  void retry_later();
  [[nodiscard]] bool keeps_trying() const { return stream_.wait || always_open(); }
  [[nodiscard]] bool always_open() const { return common_.always_open && !passive(); }

  const CommonOptions common_;
  const StreamOptions stream_;
  UniqueFd listener_fd_;
  std::optional<FdWatch> listener_watch_;
  std::unique_ptr<Connector> connector_;
  std::unique_ptr<Line> line_;
  Timer retry_timer_;  // the next connection attempt, or the next accept after a failure
  Timer line_timer_;
  Nanos retry_delay_;
  bool opened_ = false;
  bool up_ = false;           // on_up was told, on_down not yet
  bool interrupted_ = false;  // on_interrupted was told, on_resumed not yet
  bool reading_ = true;
  bool told_unknown_ = false;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
