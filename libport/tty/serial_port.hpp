#pragma once

#include <memory>
#include <optional>
#include <string>

#include "libport/base/unique_fd.hpp"
#include "libport/base/workers.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/path_watch.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {

struct SerialOptions {
  std::string device = "/dev/ttyS0";
  LineSettings settings = {};
  std::optional<bool> dtr = {};  // set after opening; none: as the kernel leaves it
  std::optional<bool> rts = {};
  bool wait = false;  // for a device that is missing, instead of failing
};

// A serial device, opened raw, exclusive (TIOCEXCL and flock), with any baud rate, read back. `alwaysopen`
// opens it in prepare(), keeps it open and opens it again when it was unplugged and comes back; `wait` waits
// for a device that is missing instead of failing. A device that goes away is closed at once, so that it
// comes back under its own name. Any other close may wait for unsent output (up to 30 s in the kernel): it is
// done on another thread, and an open() that follows waits for it.
class SerialPort final : public Port, private WaitingCalls {
 public:
  SerialPort(const PortContext& context, const CommonOptions& common, SerialOptions options);
  ~SerialPort() override;

  // Errc::device_missing unless the path is a tty that may be opened. Opens it only
  // with `alwaysopen`: opening raises DTR.
  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_ && line_->outbox.congested(); }
  bool end_writing() override { return false; }
  // What has not left this machine.
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  [[nodiscard]] WaitingCalls* waiting() override { return this; }
  [[nodiscard]] bool passive() const override { return false; }
  [[nodiscard]] bool keeps_datagrams() const override { return false; }
  [[nodiscard]] std::optional<LineSettings> settings() const override {
    return untried_.value_or(options_.settings);
  }
  Result<void> apply(const LineSettings& settings) override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] std::string name() const override { return "serial:" + options_.device; }
  [[nodiscard]] PortPlace place() const override { return {.path = options_.device}; }

 private:
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() override { return *unread_by_peer(); }
  bool discard() override;

  struct Line {
    Line(SerialPort& port, UniqueFd opened);
    UniqueFd fd;
    FdWatch watch;
    Outbox outbox;
  };

  Result<UniqueFd> open_device();
  Result<void> set_line(int fd);
  void try_settings(int fd);
  void set_modem(int fd, const char* option, int line, std::optional<bool> on) const;
  void begin_line(UniqueFd fd);
  void try_open();
  void watch_reading();
  void on_readable();
  bool read_once();
  void lost(int error_number);
  void discard_unsent();
  void drop_line();
  void close_elsewhere(UniqueFd fd);
  void closed();

  PortContext context_;
  const CommonOptions common_;
  SerialOptions options_;                // with the last settings that a line took
  std::optional<LineSettings> untried_;  // given while there was none
  std::unique_ptr<Line> line_;
  std::unique_ptr<PathWatch> waiting_;
  Workers::Strand closing_strand_;
  int closing_ = 0;  // closes under way
  bool opened_ = false;
  bool open_waits_ = false;  // for a close that is under way
  bool up_ = false;
  bool interrupted_ = false;  // lost though `alwaysopen`, and not back yet
  bool reading_ = true;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
