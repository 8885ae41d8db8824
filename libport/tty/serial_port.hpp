#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "libport/base/unique_fd.hpp"
#include "libport/base/workers.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/path_watch.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"
#include "libport/tty/line_calls.hpp"
#include "libport/tty/modem_watch.hpp"
#include "libport/tty/settings_queue.hpp"
#include "libport/tty/tty.hpp"
#include "libport/tty/uucp_lock.hpp"

namespace porttape {

struct SerialOptions {
  std::string device = "/dev/ttyS0";
  LineSettings settings = {};
  std::optional<bool> dtr = {};  // set after opening; none: as the kernel leaves it
  std::optional<bool> rts = {};
  bool wait = false;   // for a device that is missing, instead of failing
  bool follow = true;  // what apply() asks for; else it does nothing
  bool uucp_lock = false;
  std::string lock_folder = kUucpLockFolder;
};

// A serial device, opened raw, exclusive (TIOCEXCL and flock; UUCP's lock files are honoured, and made where
// that is asked for), with any baud rate, read back. `alwaysopen`
// opens it in prepare(), keeps it open and opens it again when it was unplugged and comes back; `wait` waits
// for a device that is missing instead of failing. A device that goes away is closed at once, so that it
// comes back under its own name. Any other close may wait for unsent output (up to 30 s in the kernel): it is
// done on another thread, and an open() that follows waits for it.
//
// Settings. apply() changes the line in turn with what is written (SettingsQueue). The settings of `options`
// return at close().
//
// Signals. A LineSignal that it is told drives dtr, rts and the break in turn with both. What the device does
// with its own is told where that is wanted (ModemWatch); where it has none (a pty), nothing is, and what it
// is to drive is ignored. A break that the driver leaves on ends at close(). What a driver makes of the UART
// and of RS-485 (ask()) stays, as the kernel has it.
class SerialPort final : public Port, private WaitingCalls {
 public:
  SerialPort(const PortContext& context, const CommonOptions& common, SerialOptions options,
             std::shared_ptr<LineCalls> calls = LineCalls::of_system());
  ~SerialPort() override;

  // Errc::device_missing unless the path is a tty that may be opened. Opens it only
  // with `alwaysopen`: opening raises DTR.
  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_ && line_->changes.congested(); }
  bool end_writing() override { return false; }
  // What has not left this machine.
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  [[nodiscard]] PortFacets facets() override { return {.waiting = this}; }
  [[nodiscard]] PortTraits traits() const override { return {}; }
  [[nodiscard]] std::optional<LineSettings> settings() const override {
    return line_ ? line_->changes.settings() : untried_.value_or(current_);
  }
  Result<void> apply(const LineSettings& settings) override;
  void tell(const LineEvent& event) override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] std::string name() const override { return "serial:" + options_.device; }
  [[nodiscard]] PortPlace place() const override { return {.path = options_.device}; }
  [[nodiscard]] std::optional<PortIdentity> identity() const override;

 private:
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() override { return *unread_by_peer(); }
  bool discard() override;

  struct Line {
    Line(SerialPort& port, UniqueFd opened);
    UniqueFd fd;
    FdWatch watch;
    Outbox outbox;
    SettingsQueue changes;
    std::optional<int> lines;  // the device's own, as they were told last
    std::unique_ptr<ModemWatch> modem;
  };

  void change_made(const LineSettings& wanted, const Result<TakenSettings>& taken);
  void tell_not_taken(const std::string& what);
  void watch_signals(bool on);
  void drive(const LineSignal& signal);
  void drain(RequestNumber number);
  void ask(const line::Ask& question);
  void signal_made(const LineSignal& signal, int error_number);
  void signalled(const LineSignal& signal);
  void drive_again();
  void release_driven();
  void watch_modem();
  void look_for_break(ByteView data);
  void tell_signals();
  void come_up();
  [[nodiscard]] Error in_device(const Error& error) const;
  [[nodiscard]] std::vector<LineSettings> settings_to_leave() const;
  Result<UniqueFd> open_device();
  [[nodiscard]] Result<void> check_free() const;
  Result<void> lock();
  void warn_once(const std::string& text);
  Result<void> set_line(int fd);
  void try_settings(int fd);
  void set_modem(int fd, const char* option, int line, std::optional<bool> on);
  void begin_line(UniqueFd fd);
  void try_open();
  void watch_reading();
  void on_readable();
  bool read_once();
  void lost(int error_number);
  void wait_for_device(Nanos first);
  void discard_unsent();
  void drop_line(std::vector<LineSettings> to_make);
  void close_elsewhere(Line& line, std::vector<LineSettings> to_make);
  void closed(std::size_t lost);

  PortContext context_;
  const CommonOptions common_;
  SerialOptions options_;
  const std::shared_ptr<LineCalls> calls_;
  std::optional<PortIdentity> identity_;  // none: it was not there when prepared
  LineSettings current_;                  // the last that the line took
  std::optional<LineSettings> untried_;   // given while there was no line
  bool untold_ = false;                   // the device has refused what it was to come up with
  bool told_refused_ = false;             // in this session
  std::optional<UucpLock> lock_;          // until the device is closed
  std::set<std::string> told_;            // by warn_once()
  std::unique_ptr<Line> line_;
  std::unique_ptr<PathWatch> waiting_;
  // Of a device that dies as soon as it is open.
  Backoff reopen_wait_{PathWatch::kFirst, PathWatch::kLongest};
  Instant line_began_{};
  Workers::Strand strand_;                    // for changes and closes
  int closing_ = 0;                           // closes under way
  std::shared_ptr<std::atomic<bool>> hurry_;  // of the last of them: somebody waits for it
  bool opened_ = false;
  bool open_waits_ = false;  // for a close that is under way
  bool up_ = false;
  bool interrupted_ = false;  // lost though `alwaysopen`, and not back yet
  bool reading_ = true;
  bool signals_wanted_ = false;
  std::map<LineSignal::Name, bool> driven_;               // by the driver, in this session
  std::map<LineRequest::Kind, LineRequest> made_;         // the same, of those that set something
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
