#pragma once

#include <optional>
#include <string>

#include "libport/taped/replay_port.hpp"

namespace porttape {

// A tape in the driver's place (ReplayConfig::writer): opens, sets and closes its line as recorded, once, and
// is the driver's port of a session whose other port is the device's. The session ends with the tape.
class ReplayedDriver final : public ReplayPort {
 public:
  ReplayedDriver(const PortContext& context, ReplayOptions options);

  void open() override;
  void close() override;
  void write(ByteView data) override;
  // False where the tape has not even an end of what its device sends: that has ended its line.
  bool end_writing() override;
  // As it was when the recorded driver opened it.
  [[nodiscard]] std::optional<LineSettings> settings() const override;
  // Nothing: what the driver found is on the tape.
  Result<void> apply(const LineSettings&) override { return {}; }
  void set_reading(bool on) override;
  [[nodiscard]] PortTraits traits() const override;
  // Its device has ended the line.
  void hang_up(bool after_reading) override;

 private:
  void break_line(ReplayActions&) override { close_line(LineDown::Reason::hung_up); }
  void step_line(const LineStep& step) override;
  void run_ended(RunReport report) override;
  void tape_lost(const std::string&) override {}  // the run's end is the session's
  void pumped() override { watch_silence(); }
  [[nodiscard]] std::string why_in_order() const override {
    return "it plays the driver, whose line has its own course";
  }

  void open_line();
  void close_line(LineDown::Reason reason);
  void watch_silence();
  void end_silence();

  Timer silence_timer_;
  Instant last_heard_{};       // or the line took something
  bool line_open_ = false;     // as its session knows it
  bool coming_up_ = false;     // the device's line has not come up since
  bool blocked_ = false;       // the device's line takes nothing
  std::string ended_because_;  // for the report of the run that ends now
};

}  // namespace porttape
