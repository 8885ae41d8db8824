#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/taped/aftermath.hpp"
#include "libport/taped/replay_port.hpp"

namespace porttape {

// A tape in the device's place. Each session's bytes come as recorded; with `once` the session ends after the
// first run that was more than a look.
class ReplayedDevice final : public ReplayPort, private WaitingCalls {
 public:
  ReplayedDevice(const PortContext& context, ReplayOptions options);
  ~ReplayedDevice() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  // As the tape's device has its line: its own when the session begins, then what the driver asks for, where
  // the tape does not tell that it took something else, or refused. None where the tape tells of none.
  [[nodiscard]] std::optional<LineSettings> settings() const override { return settings_; }
  Result<void> apply(const LineSettings& settings) override;
  // Besides: a drain lasts as long as the one did that has its place on the tape, by the replay's rate; where
  // the tape has none, no time.
  void tell(const LineEvent& event) override;
  [[nodiscard]] PortFacets facets() override { return {.waiting = this, .playback = this}; }
  // Each block of a tape of UDP was a datagram.
  [[nodiscard]] PortTraits traits() const override;
  // A tape's device has no line to break.
  void hang_up(bool) override {}
  void finish() override;

 private:
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() override { return 0; }
  // As a flush by the driver, but only where answers follow their questions: a tape that plays by a clock may
  // lag behind a slow reader.
  bool discard() override;
  [[nodiscard]] std::string awaits() override;
  [[nodiscard]] std::optional<Instant> next_due() override {
    return prepared() ? engine()->next_deadline() : std::nullopt;
  }

  void break_line(ReplayActions& actions) override;
  void step_line(const LineStep&) override {}
  void run_ended(RunReport report) override;
  void tape_lost(const std::string& why) override;
  [[nodiscard]] std::string why_in_order() const override;

  void begin_drain(RequestNumber number);
  void end_drains();
  void end_aftermath(RunReport report, const LineDown& down);
  void hand_on_held();

  std::optional<LineSettings> settings_;
  std::unique_ptr<Aftermath> aftermath_;
  // Of a run that ended with the tape while its driver was there: waits for how much that left unread.
  std::optional<RunReport> held_;
  std::vector<RequestNumber> drains_;  // that last
  std::size_t drains_begun_ = 0;       // in this run
  Timer drain_timer_;
};

}  // namespace porttape
