#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

#include "libport/base/end_wait.hpp"
#include "libport/base/tty_device.hpp"
#include "libport/line/waiting_events.hpp"
#include "libport/line/waiting_requests.hpp"
#include "libport/loop/backoff.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/timer.hpp"
#include "libport/loop/urgent_events.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/tty/pty.hpp"
#include "libport/tty/pty_names.hpp"
#include "libport/tty/pty_settings.hpp"

namespace porttape {

struct PtyOptions {
  std::string link = {};  // none of both: the slave's path is printed
  std::string bind = {};
  Pty::Access access = {};
};

// A pseudo-terminal that a program opens as if it were the device. Passive: up while a program has the slave
// open. Owns the pty and its names. One peer at a time: a second program that opens it shares the line, as
// on a real tty.
//
// Sessions are made of what is known of the openers:
//
// | what is seen                      | openers before | then                                             |
// |-----------------------------------|----------------|--------------------------------------------------|
// | an open                           | no session     | a session begins                                 |
// | an open                           | 0              | closed and opened again: one ends, one begins    |
// | an open                           | 1 or more      | one more, the session goes on                    |
// | an open                           | unknown        | the session goes on                              |
// | a close                           | known          | one less; that nobody is left, HUP says          |
// | HUP, no byte left (read: EIO)     | any            | the session ends; opens after that last close    |
// |                                   |                | begin the next                                   |
// | HUP, and reading is off           | any            | what is left is kept while the device takes      |
// |                                   |                | bytes, and 10 s for one that comes or takes      |
// |                                   |                | none; then it is dropped and told, and the       |
// |                                   |                | session ends                                     |
// | no HUP and no session, where      | 0, or lost     | a session begins                                 |
// | events were lost or opens cannot  |                |                                                  |
// | be told one by one                |                |                                                  |
// | a last close and no session,      | 0, or lost     | a session begins, which HUP ends: somebody came  |
// | there too                         |                | and went between two looks                       |
//
// Their number is exact where each open and close is told (Pty::exact). It is unknown after an open that may
// stand for several, after lost events, and for a session that was found without an event. HUP, which the
// kernel shows while nobody has the slave open, is always true, and with it the number is 0.
//
// Settings. Each driver finds the line as apply() has it. What one makes different is seen by looking: around
// each read, when it opens and closes, and by the loop's sampler; the kernel tells of no change. So a change
// and bytes that are found together may have come in either order: told first is the one that was seen first,
// a change before bytes that wait with it, and the order as `sampled`. A supervisor of the driver tells them
// instead (SupervisedLine), with signals, which a pty does not have.
class PtyPort final : public Port, private SupervisedLine {
 public:
  PtyPort(const PortContext& context, PtyOptions options);
  ~PtyPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  Result<void> apply(const LineSettings& settings) override;
  void tell(const LineEvent& event) override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_ && line_->outbox.congested(); }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  void set_reading(bool on) override;
  // Replaces the pty by a new one under the same link; on_down(hung_up) follows. Without a link the new path
  // is printed.
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] bool left_bytes() const override;
  void finish() override;
  [[nodiscard]] PortFacets facets() override { return {.supervised = this}; }
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = true, .shows_signals = supervisor_ != nullptr};
  }
  bool end_writing() override { return false; }
  [[nodiscard]] std::string name() const override;
  [[nodiscard]] PortPlace place() const override;

 private:
  using Openers = std::optional<int>;  // how many descriptors programs have open; none: unknown

  static constexpr std::size_t kReadSize = 4096;  // a status byte and the 4095 bytes that a pty gives at most

  // What belongs to one pty and goes with it.
  struct Line {
    Line(PtyPort& port, Pty made);
    Pty pty;
    std::optional<TtyDevice> device;
    PtySettings settings;
    std::unique_ptr<UrgentEvents::Watch> clocal_watch;  // keeps it cleared; null: the looks alone do
    FdWatch master_watch;
    Outbox outbox;
  };

  void supervise(LineSupervisor* supervisor) override;
  [[nodiscard]] int line_fd() const override { return line_ ? line_->pty.master() : -1; }
  [[nodiscard]] std::optional<TtyDevice> line_device() const override {
    return line_ ? line_->device : std::nullopt;
  }
  bool catch_up() override;
  [[nodiscard]] std::uint64_t passed_on() const override { return passed_on_; }
  void peer_did(const LineEvent& event) override;
  void wait_until_sent(std::function<void()> done) override;
  void ask(const LineRequest& request, TakeAnswer done) override;

  Result<void> make_line();
  void replace_line();
  void drop_line();
  void renew_line();
  void line_renewed();
  void look();
  Result<void> show(const LineSettings& settings);
  void show_home();
  void watch_settings();
  void look_at_settings(bool moved_on);
  void tell_settings(const SeenSettings& seen, SettingsOrder order);
  void driver_flushed(FlushQueue queue);
  void on_event();
  void handle_events(const std::vector<Pty::Event>& events);
  void handle_event(Pty::Event event);
  void count(Pty::Event event);
  void watch_reading();
  void look_unread();
  void on_unread_timer();
  void drop_rest(std::string_view why);
  void on_readable();
  ssize_t read_packet();
  bool read_once();  // true when there may be more
  [[nodiscard]] bool may_deliver() const { return peer_ && accepting_ && reading_; }
  void take_packet(ByteView packet);
  void handle_packet(ByteView packet);
  void deliver_held();
  void deliver_held_soon();
  void peer_arrived(Openers openers);
  void master_ended();
  void peer_left();
  void peer_reopened();
  void tell_left(std::size_t unsent, std::optional<std::size_t> in_kernel);
  void drop_unsent();
  void drop_held();
  void set_up(bool up, LineDown::Reason reason = LineDown::Reason::closed);
  void tell_opened();
  void on_hang_up_timer();
  void tell_waiting();

  PortContext context_;
  Pty::Access access_;
  PtyNames names_;
  LineSupervisor* supervisor_ = nullptr;
  std::uint64_t passed_on_ = 0;  // bytes of the peer
  WaitingRequests<std::function<void()>> drains_;
  WaitingRequests<TakeAnswer> questions_;
  WaitingEvents early_;               // of a driver that has opened the line, until the listener knows it
  std::optional<LineSettings> home_;  // what the next driver finds; none: what the last one left
  std::unique_ptr<Line> line_;        // null before prepare(), and while no new pty can be made
  Timer hang_up_timer_;
  Timer renew_timer_;  // while there is no line
  Backoff renew_wait_;
  Timer unread_timer_;                    // while bytes of one that has gone are not read
  std::optional<EndWait> rest_wait_;      // not read, and seen to have closed
  std::optional<Instant> unknown_since_;  // hanging up, without seeing whether the driver has read everything
  Bytes held_;  // a packet that was read when the session began or reading stopped: delivered first
  Openers openers_ = 0;
  bool events_lost_ = false;    // since HUP was seen last
  bool told_replaced_ = false;  // that a pty which could not be made fresh gave way to a new one
  bool accepting_ = false;
  bool peer_ = false;
  bool up_ = false;
  bool reading_ = true;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
