#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/backoff.hpp"
#include "libport/loop/timer.hpp"
#include "libport/net/connector.hpp"
#include "libport/net/stream_line.hpp"
#include "libport/net/stream_listener.hpp"
#include "libport/net/tcp_peer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {

// What TCP and Unix stream sockets have alike.
struct StreamOptions {
  bool listen = false;
  bool wait = false;                   // for a peer that is missing, instead of failing
  std::size_t most_connections = 256;  // where all are given away
};

// A stream socket, TCP or Unix: where both have their connections from; one of them is a StreamLine. It
// connects at each open(), or (`listen`) waits for peers and is passive, or has one connection that a
// listening port gave away, and comes up once.
//
// Listening: one peer at a time, see StreamListener for the next ones; with give_each() every connection is
// given away. A peer that has only ended its sending
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
// line::Dropped.
class StreamPort : public Port,
                   private WaitingCalls,
                   private ConnectionSource,
                   private StreamLine::Owner,
                   private StreamListener::Owner {
 public:
  ~StreamPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_ && line_->congested(); }
  // Once a TCP peer's machine has them all it counts as read.
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  [[nodiscard]] PortFacets facets() override {
    return {.waiting = this, .connections = stream_.listen ? this : nullptr};
  }
  // A drain ends when the kernel has what was written before it.
  void tell(const LineEvent& event) override;
  bool end_writing() override;
  // Not where the next session writes on the same connection.
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = stream_.listen, .has_half_close = !always_open()};
  }
  [[nodiscard]] bool left_bytes() const override { return line_ && line_->left_bytes(); }

 protected:
  StreamPort(const PortContext& context, const CommonOptions& common, StreamOptions options);
  // Of the connection `given`, if there is one.
  StreamPort(const PortContext& context, const CommonOptions& common, StreamOptions options, UniqueFd given);

  // What the kinds of sockets do differently. A listening socket, bound; Errc::usage or Errc::io.
  virtual Result<UniqueFd> make_listener() = 0;
  virtual Result<void> check_peer() { return {}; }  // before the first connection, without making one
  virtual void connect_to_peer(Connector& connector) = 0;
  virtual void set_up(int fd) { (void)fd; }
  virtual PeerState peer_state(int fd) const = 0;  // asked by look_at_peer() alone
  // Whether its peer connected to it, not the other way round.
  [[nodiscard]] bool is_called() const { return passive() || was_given_; }
  // A port for a connection of a listening one.
  virtual std::unique_ptr<StreamPort> port_of(UniqueFd connection) = 0;

  // The options of such a port.
  [[nodiscard]] CommonOptions common_of_connections() const;

  PortContext context_;

 private:
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() override { return *unread_by_peer(); }
  bool discard() override;

  void line_data(ByteView data) override;
  void line_drained() override;
  void line_told(const LineEvent& event) override;
  PortListener::Answers line_ended() override;
  void line_over(const LineDown& down) override;
  void dropped(std::uint64_t bytes, const char* why) override;
  bool wants_rest() override { return listener().wants_rest(); }
  std::optional<std::size_t> unread_elsewhere() override { return listener().unread(); }
  PeerState look_at_peer(int fd) override;
  bool next_waits() override { return door_ && door_->next_waits(); }

  void give_each(TakeConnection take) override { take_ = std::move(take); }
  [[nodiscard]] std::size_t most_connections() const override { return stream_.most_connections; }
  StreamListener::Inside inside() override;
  void let_in(UniqueFd fd, const std::string& who) override;
  void refused(std::uint64_t bytes) override { listener().told(line::Refused{bytes}); }

  void connect();
  void connected(Result<UniqueFd> result);
  void come_up(UniqueFd fd);
  void begin_line(UniqueFd fd);
  void drop_line(bool orderly);
  void retry_later();
  [[nodiscard]] bool keeps_trying() const { return stream_.wait || always_open(); }
  [[nodiscard]] bool always_open() const { return common_.always_open && !stream_.listen; }

  const CommonOptions common_;
  const StreamOptions stream_;
  std::optional<StreamListener> door_;  // of a listening one
  TakeConnection take_;                 // gives each of its connections away
  UniqueFd given_;                      // until it is a line
  const bool was_given_;
  std::unique_ptr<Connector> connector_;
  std::unique_ptr<StreamLine> line_;
  Timer retry_timer_;   // the next connection attempt
  Backoff retry_wait_;  // a peer that closes at once is not called at once again
  Instant line_began_{};
  bool opened_ = false;
  bool up_ = false;           // on_up was told, on_down not yet
  bool interrupted_ = false;  // on_interrupted was told, on_resumed not yet
  bool reading_ = true;
  bool told_unknown_ = false;                             // that the kernel does not tell about peers
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
