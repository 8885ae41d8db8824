#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/tape_part.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/taped/replay_reports.hpp"

namespace porttape {

// A tape in the device's place: reads the tape and the clock, and does what the engine says. Each run's
// report goes to the log and, when asked for, to a file; with `once` the session ends after the first run.
// The exit status is that of the worst run.
class ReplayPort final : public Port, private WaitingCalls {
 public:
  struct Options {
    TapePaths tape;
    ReplayConfig config;
    bool once = false;
    std::uint64_t session = 0;  // only this one of the tape is played, 1-based; 0: all of them
    std::string report_file = {};
    std::shared_ptr<const Expectation> expectation = {};  // what of a write may vary; null: nothing
    // That other ports play by too, with its rate instead of the one in `config`; null: the context's, or one
    // of its own. On a shared one tapes begin as their zeros lie, and one without a zero with the first.
    std::shared_ptr<ReplayClock> clock = {};
    // The tape is that of this connection, one of several, and the report file has the runs of all.
    std::optional<unsigned> connection = {};
    std::shared_ptr<ReplayReports::Group> group = {};
    std::function<void(const RunReport&)> on_report = {};  // each run's, or empty
    // The program ends soon, and has no other ports: where the tape has no reopen, opens are looked for in
    // the first 30 ms instead of being told by inotify, which takes the kernel some 15 ms to close.
    bool brief = false;
  };

  ReplayPort(const PortContext& context, Options options);
  ~ReplayPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  bool end_writing() override;
  [[nodiscard]] bool has_half_close() const override { return true; }
  // A driver that writes on while the tape is read on to where it writes.
  [[nodiscard]] bool congested() const override { return congested_; }
  // A driver that flushes what came to it: what is due counts as read, if the tape is stamped at arrival. A
  // tape of another recorder (without events) holds what its driver read, and nothing that was flushed. A
  // flush on the tape has no effect: the driver makes its own.
  void peer_flushed(FlushQueue queue) override;
  [[nodiscard]] WaitingCalls* waiting() override { return this; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return std::nullopt; }
  void read_pending() override {}
  [[nodiscard]] bool passive() const override { return false; }
  // Each block of a tape of UDP was a datagram.
  [[nodiscard]] bool keeps_datagrams() const override { return datagrams_; }
  void set_reading(bool on) override;
  void hang_up(bool) override {}
  // Ends the run; the status is that of the worst verdict, and where no driver has come, or none that did
  // more than look, that of `incomplete`. Takes 5 s at most: what is not known or not written then is told.
  void finish() override;
  [[nodiscard]] std::string name() const override { return "logreader:" + options_.tape.name(); }

  // The latest run's, a look's too, once it is complete.
  [[nodiscard]] const std::optional<RunReport>& report() const { return report_; }

 private:
  std::size_t write_some(ByteView data) override {
    write(data);
    return data.size();
  }
  [[nodiscard]] std::size_t unsent() override { return 0; }
  // As peer_flushed(), but only where answers follow their questions: a tape that plays by a clock may lag
  // behind a slow reader.
  bool discard() override;
  [[nodiscard]] std::string awaits() override;
  [[nodiscard]] std::optional<Instant> next_due() override {
    return engine_ ? engine_->next_deadline() : std::nullopt;
  }

  void pump();
  [[nodiscard]] Instant pump_time(Instant now) const;
  void perform(ReplayActions& actions);
  void set_timer();
  [[nodiscard]] bool may_spin(Instant due) const;
  void on_timer();
  void take_report(RunReport report);
  void publish(const RunReport& report);
  void continue_finish();
  void add_stalls(RunReport& report, Instant begun) const;
  [[nodiscard]] int status() const;

  PortContext context_;
  Options options_;
  std::optional<TapeReader> schedule_;
  std::optional<TapeReader> writes_;
  std::optional<PartOfTape> schedule_part_;  // of those, where not all is played
  std::optional<PartOfTape> writes_part_;
  std::unique_ptr<Engine> engine_;
  Timer timer_;
  std::unique_ptr<ReplayReports> reports_;
  std::optional<RunReport> report_;
  std::optional<Instant> run_begun_;
  std::optional<Timer> finish_timer_;
  Instant finish_limit_{};
  bool any_run_ = false;  // has ended
  bool report_failed_ = false;
  bool congested_ = false;
  bool reading_on_ = false;  // the engine has used up its budget
  bool open_ = false;
  bool dropping_ = false;
  bool datagrams_ = false;
};

}  // namespace porttape
