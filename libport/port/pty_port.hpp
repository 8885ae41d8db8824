#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "libport/port/context.hpp"
#include "libport/port/fd_watch.hpp"
#include "libport/port/outbox.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"
#include "libport/port/pty.hpp"
#include "libport/port/pty_link.hpp"
#include "libport/port/timer.hpp"

namespace porttape {

// A pseudo-terminal that a program opens as if it were the device. Passive: up while a program has the slave
// open. Owns the pty and its link. One peer at a time: a second program that opens it shares the line, as on
// a real tty.
class PtyPort final : public Port {
 public:
  PtyPort(const PortContext& context, const PortOptions& options);
  ~PtyPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_ && line_->outbox.congested(); }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  void set_reading(bool on) override;
  // Replaces the pty by a new one under the same link; on_down(hung_up) follows. Without a link the new path
  // is printed.
  void hang_up(bool after_reading) override;
  void read_pending() override;
  void finish() override;
  [[nodiscard]] bool passive() const override { return true; }
  [[nodiscard]] std::string name() const override;

 private:
  static constexpr std::size_t kReadSize = 4096;  // a status byte and the 4095 bytes that a pty gives at most

  // What belongs to one pty and goes with it.
  struct Line {
    Line(PtyPort& port, Pty made);
    Pty pty;
    FdWatch master_watch;
    FdWatch wake_watch;
    Outbox outbox;
  };

  Result<void> make_line();
  void announce_path() const;
  void replace_line();
  void renew_line();
  void look();  // whether a peer is there that no event told of
  void on_wake();
  void take_events();
  void watch_reading();
  void on_readable();
  bool read_once();  // true when there may be more
  [[nodiscard]] bool may_deliver() const { return peer_ && accepting_ && reading_; }
  void take_packet(ByteView packet);
  void handle_packet(ByteView packet);
  void deliver_held();
  void deliver_held_soon();
  void peer_arrived();
  void peer_left();
  void peer_reopened();
  void drop_unsent();
  void drop_held();
  void set_up(bool up, LineDown::Reason reason = LineDown::Reason::closed);
  void on_hang_up_timer();
  void on_look_timer();

  PortContext context_;
  PortOptions options_;
  std::optional<PtyLink> link_;
  std::unique_ptr<Line> line_;  // null before prepare(), and while no new pty can be made
  Timer hang_up_timer_;
  Timer look_timer_;   // no event tells of changed settings
  Timer renew_timer_;  // while there is no line
  Instant arrived_{};
  std::array<Byte, kReadSize> buffer_{};
  Bytes held_;       // a packet that was read when the session began or reading stopped: delivered first
  int openers_ = 0;  // an estimate (inotify merges events); only decides whether CLOSE, OPEN was a reopen
  bool accepting_ = false;
  bool peer_ = false;
  bool up_ = false;
  bool reading_ = true;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
