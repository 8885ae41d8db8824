#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/replay/engine.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/replay_reports.hpp"
#include "libport/taped/replay_sources.hpp"
#include "libport/taped/run_notes.hpp"

namespace porttape {

// A tape at one end of a line: reads the tape and the clock, and does what the engine says. Each run's report
// goes to the log and, when asked for, to a file. The exit status is that of the worst run. What the line is
// like at that end is in the classes of the two ends, ReplayedDevice and ReplayedDriver.
class ReplayPort : public Port, public Playback {
 public:
  ~ReplayPort() override;

  Result<void> prepare() override;
  void write(ByteView data) override;
  bool end_writing() override;
  // A peer that writes on while the tape is read on to where it writes.
  [[nodiscard]] bool congested() const override { return congested_; }
  // What the peer does to its line:
  // - One that flushes what came to it: what is due counts as read, if the tape is stamped at arrival. A tape
  //   of another recorder (without events) holds what its driver read, and nothing that was flushed. A flush
  //   on the tape has no effect: the peer makes its own.
  // - A fault: each run's report has what was done to its line.
  void tell(const LineEvent& event) override;
  [[nodiscard]] PortFacets facets() override { return {.playback = this}; }
  Result<void> request(const PlaybackRequest& what) override;
  [[nodiscard]] PlaybackStatus playback() override;
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return std::nullopt; }
  void read_pending() override {}
  void set_reading(bool on) override;
  // Ends the run; the status is that of the worst verdict, and where no peer has come, or none that did more
  // than look, that of `incomplete`. Takes 5 s at most: what is not known or not written then is told.
  void finish() override;
  [[nodiscard]] std::string name() const override { return "logreader:" + options_.tape.name(); }
  // Of the recorded device, as the tape has it.
  [[nodiscard]] std::optional<PortIdentity> identity() const override;

  // The latest run's, a look's too, once it is complete.
  [[nodiscard]] const std::optional<RunReport>& report() const { return report_; }

 protected:
  ReplayPort(const PortContext& context, ReplayOptions options);

  // A session begins, and ends.
  void begin_session();
  void end_session() { open_ = false; }
  [[nodiscard]] bool is_open() const { return open_; }
  // The peer's line is up.
  void begin_run(Instant now);
  // Does what is due, as long as something is. The engine was told something, or its time has come.
  void pump();
  // As pump(), and what is due is not passed on.
  void drop_due();
  // A run has ended: adds what the engine does not know of it.
  void take_report(RunReport report);
  // The report is complete, but for what its readers wait for.
  void hand_on(RunReport report);
  // The one run that was asked for is over.
  void ask_for_end();

  [[nodiscard]] const PortContext& context() const { return context_; }
  [[nodiscard]] const ReplayOptions& options() const { return options_; }
  [[nodiscard]] Instant now() const { return context_.loop->now(); }
  // prepare() has made what follows.
  [[nodiscard]] bool prepared() const { return engine_ != nullptr; }
  [[nodiscard]] const ReplaySources& sources() const { return *sources_; }
  [[nodiscard]] ReplayReports& reports() { return *reports_; }
  [[nodiscard]] RunNotes& notes() { return notes_; }
  [[nodiscard]] Engine* engine() const { return engine_.get(); }
  [[nodiscard]] bool finishing() const { return finish_timer_.has_value(); }

 private:
  // The engine wants the line to break; `actions` has what is not done yet.
  virtual void break_line(ReplayActions& actions) = 0;
  // The engine wants the driver's line to change; only where the tape plays the driver.
  virtual void step_line(const LineStep& step) = 0;
  // The engine has ended a run; the report has all but what is told behind its end.
  virtual void run_ended(RunReport report) = 0;
  // The tape cannot be read on; its run has ended.
  virtual void tape_lost(const std::string& why) = 0;
  // All that was due is done.
  virtual void pumped() {}
  // Why no other place of the tape can be gone to by hand; empty: one can.
  [[nodiscard]] virtual std::string why_in_order() const = 0;

  void flushed(const line::Flush& flush);
  [[nodiscard]] Result<void> check_seek(Micros to) const;
  [[nodiscard]] Instant pump_time(Instant now) const;
  void deliver(const ReplayActions& actions);
  void perform(ReplayActions& actions);
  void set_timer();
  [[nodiscard]] bool may_spin(Instant due) const;
  void on_timer();
  void publish(const RunReport& report);
  void continue_finish();
  [[nodiscard]] int status() const;

  PortContext context_;
  ReplayOptions options_;
  std::optional<ReplaySources> sources_;
  RunNotes notes_;
  std::unique_ptr<Engine> engine_;
  Timer timer_;
  std::unique_ptr<ReplayReports> reports_;
  std::optional<RunReport> report_;
  std::optional<Timer> finish_timer_;
  Instant finish_limit_{};
  bool any_run_ = false;  // has ended
  bool report_failed_ = false;
  bool congested_ = false;
  bool reading_on_ = false;  // the engine has used up its budget
  bool open_ = false;
  bool dropping_ = false;
};

}  // namespace porttape
