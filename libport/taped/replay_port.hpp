#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/replay/device_line.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/output_flushes.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/aftermath.hpp"
#include "libport/taped/played_tape.hpp"
#include "libport/taped/replay_reports.hpp"
#include "libport/taped/tape_answers.hpp"
#include "libport/taped/unread_tally.hpp"

namespace porttape {

// A tape in the device's place, or the driver's (ReplayConfig::writer): reads the tape and the clock, and
// does what the engine says. As a driver it opens, sets and closes its line as recorded, once, and is the
// driver's port of a session whose other port is the device's. Each run's report goes to the log and, when
// asked for, to a file; with `once` the session ends after the first run. The exit status is that of the
// worst run.
class ReplayPort final : public Port, public Playback, private WaitingCalls {
 public:
  struct Options {
    TapePaths tape;
    ReplayConfig config;
    bool once = false;
    bool start_paused = false;
    std::uint64_t session = 0;  // only this one of the tape is played, 1-based; 0: all of them
    std::string report_file = {};
    std::string junit_file = {};
    std::shared_ptr<const Expectation> expectation = {};  // what of a write may vary; null: nothing
    // That other ports play by too, with its rate instead of the one in `config`; null: the context's, or one
    // of its own. On a shared one tapes begin as their zeros lie, and one without a zero with the first.
    std::shared_ptr<ReplayClock> clock = {};
    // The tape is that of this connection, one of several, and the report file has the runs of all.
    std::optional<unsigned> connection = {};
    std::shared_ptr<ReplayReports::Group> group = {};
    std::function<void(const RunReport&)> on_report = {};  // each run's, or empty
    // After a mismatch that fails the run the line hangs up a moment later, so that the report knows more.
    bool looks_on = false;
    // The program ends soon, and has no other ports: where the tape has no reopen, opens are looked for in
    // the first 30 ms instead of being told by inotify, which takes the kernel some 15 ms to close.
    bool brief = false;
    // finish() comes because the run is over, as when its command has ended, and not because somebody asks
    // for an end: it waits until the whole tape is counted.
    bool ends_with_run = false;
    // Where it plays the driver: how long the device may be silent, beyond the time it took on the tape, or
    // its line take nothing; none: for ever.
    std::optional<Nanos> silence = {};
    bool waits_for_line = false;  // to come up, however long
    bool keeps_line = false;  // as the device's port has it: not as it was when the recorded driver opened it
  };

  ReplayPort(const PortContext& context, Options options);
  ~ReplayPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  bool end_writing() override;
  // A driver that writes on while the tape is read on to where it writes.
  [[nodiscard]] bool congested() const override { return congested_; }
  // As the tape's device has its line: its own when the session begins, then what the driver asks for, where
  // the tape does not tell that it took something else, or refused. None where the tape tells of none.
  [[nodiscard]] std::optional<LineSettings> settings() const override { return settings_; }
  Result<void> apply(const LineSettings& settings) override;
  // What the driver does to its line:
  // - A driver that flushes what came to it: what is due counts as read, if the tape is stamped at arrival. A
  //   tape of another recorder (without events) holds what its driver read, and nothing that was flushed. A
  //   flush on the tape has no effect: the driver makes its own.
  // - A drain lasts as long as the one did that has its place on the tape, by the replay's rate; where the
  //   tape has none, no time.
  // - A fault: each run's report has what was done to its line.
  void tell(const LineEvent& event) override;
  [[nodiscard]] PortFacets facets() override { return {.waiting = this, .playback = this}; }
  Result<void> request(const PlaybackRequest& what) override;
  [[nodiscard]] PlaybackStatus playback() override;
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return std::nullopt; }
  void read_pending() override {}
  // Each block of a tape of UDP was a datagram.
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = drives(), .keeps_datagrams = datagrams_, .has_half_close = true};
  }
  void set_reading(bool on) override;
  // The device of a tape has no line to break; the driver of one has, when its device has ended it.
  void hang_up(bool after_reading) override;
  // Ends the run; the status is that of the worst verdict, and where no driver has come, or none that did
  // more than look, that of `incomplete`. Takes 5 s at most: what is not known or not written then is told.
  void finish() override;
  [[nodiscard]] std::string name() const override { return "logreader:" + options_.tape.name(); }
  [[nodiscard]] std::optional<PortIdentity> identity() const override { return identity_; }

  // The latest run's, a look's too, once it is complete.
  [[nodiscard]] const std::optional<RunReport>& report() const { return report_; }

 private:
  std::size_t write_some(ByteView data) override {
    write(data);
    return data.size();
  }
  [[nodiscard]] std::size_t unsent() override { return 0; }
  // As a flush by the driver, but only where answers follow their questions: a tape that plays by a clock may
  // lag behind a slow reader.
  bool discard() override;
  [[nodiscard]] std::string awaits() override;
  [[nodiscard]] std::optional<Instant> next_due() override {
    return engine_ ? engine_->next_deadline() : std::nullopt;
  }

  void driver_flushed(FlushQueue queue);
  void begin_drain(RequestNumber number);
  void note_fault(const LineFault& fault);
  [[nodiscard]] bool drives() const { return options_.config.writer == Writer::device; }
  void open_line();
  void close_line(LineDown::Reason reason);
  void do_step(const LineStep& step);
  void watch_silence();
  void end_silence();
  Result<Engine::Parts> parts(const PlayedAs& as);
  Result<void> check_start(RecordSource& tape, TapeTime last_event);
  [[nodiscard]] Result<void> check_seek(Micros to) const;
  void pump();
  [[nodiscard]] Instant pump_time(Instant now) const;
  void deliver(const ReplayActions& actions);
  void perform(ReplayActions& actions);
  void end_drains();
  void set_timer();
  [[nodiscard]] bool may_spin(Instant due) const;
  void on_timer();
  void hang_up_driver(ReplayActions& actions);
  void end_aftermath(RunReport report, const LineDown& down);
  void take_report(RunReport report);
  void hand_on(RunReport report);
  void hand_on_held();
  void publish(const RunReport& report);
  void continue_finish();
  [[nodiscard]] std::optional<Doubt> take_refused();
  void add_output_flushes(RunReport& report);
  void add_stalls(RunReport& report, Instant begun) const;
  [[nodiscard]] int status() const;

  PortContext context_;
  Options options_;
  std::optional<PortIdentity> identity_;  // of the recorded device, as the tape has it
  std::unique_ptr<PlayedTape> schedule_;
  std::unique_ptr<PlayedTape> writes_;
  PlayedAs played_as_;
  std::unique_ptr<PlayedTape> index_;  // with match=lookup or on-mismatch=resync
  std::unique_ptr<TapeAnswers> answers_;
  DeviceLine line_;
  std::optional<bool> ended_;       // see TapeFacts
  std::vector<Doubt> tape_doubts_;  // of each run that somebody came to
  std::optional<TapeTime> length_;  // of what is played, if known
  std::optional<LineSettings> own_settings_;
  std::optional<LineSettings> settings_;
  std::unique_ptr<Engine> engine_;
  Timer timer_;
  std::unique_ptr<ReplayReports> reports_;
  std::optional<RunReport> report_;
  std::unique_ptr<Aftermath> aftermath_;
  // Of a run that ended with the tape while its driver was there: waits for how much that left unread.
  std::optional<RunReport> held_;
  // Since the last report: who was turned away, and what it had written.
  std::uint64_t refused_ = 0;
  std::uint64_t refused_bytes_ = 0;
  // In this run.
  std::uint64_t written_ = 0;  // bytes of the driver's
  OutputFlushes output_flushes_;
  UnreadTally unread_;
  std::optional<FaultsReport> faults_;  // of the run that goes on
  std::optional<Instant> run_begun_;
  std::vector<RequestNumber> drains_;  // that last
  std::size_t drains_begun_ = 0;       // in this run
  Timer drain_timer_;
  std::optional<Timer> finish_timer_;
  Instant finish_limit_{};
  bool any_run_ = false;  // has ended
  bool report_failed_ = false;
  bool congested_ = false;
  bool reading_on_ = false;  // the engine has used up its budget
  bool open_ = false;
  bool dropping_ = false;
  bool datagrams_ = false;

  // Of the driver that it plays.
  Timer silence_timer_;
  Instant last_heard_{};       // or the line took something
  bool line_open_ = false;     // as its session knows it
  bool coming_up_ = false;     // the device's line has not come up since
  bool blocked_ = false;       // the device's line takes nothing
  std::string ended_because_;  // for the report of the run that ends now
};

}  // namespace porttape
