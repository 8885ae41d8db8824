#include "libport/taped/replay_port.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>

#include "libport/base/printable.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/replay/pieces.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/tape_count.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/tape_facts.hpp"

namespace porttape {
namespace {

// Timers wake 20 to 100 µs late; the rest of the way is spun, which is late by less than a microsecond.
constexpr Nanos kSpin = std::chrono::microseconds(120);
constexpr Nanos kBrief = std::chrono::milliseconds(30);
constexpr std::uintmax_t kSmallTape = 65536;  // bytes of its files
// Of what the driver wrote and the engine has not looked at: beyond, it is not read on.
constexpr std::size_t kMostBacklog = 65536;
// Between two slices of reading on, for all else on the loop.
constexpr Nanos kPause = std::chrono::microseconds(50);
// The end: how long the engine may read on, and how long all of it may take. After a run that ends the
// program, finish() waits for the tape to be counted. An end that a signal or `ctl stop` asks for does not
// wait so long: the report then says that the tape was not counted.
constexpr Nanos kReadOnLimit = std::chrono::seconds(3);
constexpr Nanos kFinishLimit = std::chrono::seconds(5);
constexpr Nanos kAskedReadOnLimit = std::chrono::milliseconds(400);
constexpr Nanos kAskedFinishLimit = std::chrono::milliseconds(1400);
// A program that waits in a call gets what is due in one go, up to so many steps.
constexpr int kMostSteps = 1024;
// Between two looks whether the driver has read a piece of chunks=bytes or random.
constexpr Nanos kLook = std::chrono::microseconds(50);
// Spinning takes at most this part of a core for all tapes together, else dense ones would keep it from the
// drivers.
constexpr int kSpinShare = 5;

// Whether it is read in no time.
bool is_small(const TapePaths& paths) {
  std::uintmax_t size = 0;
  for (const auto& path : {paths.read, paths.write}) {
    std::error_code absent;
    const std::uintmax_t bytes = std::filesystem::file_size(path, absent);
    if (!absent) size += bytes;
  }
  return size <= kSmallTape;
}

std::optional<TapeTotals> count_at_once(RecordSource& tape, TapeTime start) {
  const std::optional<TapeTotals> totals = count_tape(tape, {}, start);
  return tape.rewind() ? totals : std::nullopt;
}

double seconds_of(TapeTime time) { return static_cast<double>(to_us(time)) / 1e6; }

}  // namespace

ReplayPort::ReplayPort(const PortContext& context, Options options)
    : context_(context),
      options_(std::move(options)),
      timer_(*context.loop, [this] { on_timer(); }),
      drain_timer_(*context.loop, [this] { end_drains(); }),
      silence_timer_(*context.loop, [this] { end_silence(); }) {
  if (!options_.clock) options_.clock = context_.replay_clock;
}

ReplayPort::~ReplayPort() = default;

Result<void> ReplayPort::prepare() {
  const ReplayConfig& config = options_.config;
  Result<TapeFacts> known = tape_facts(options_.tape, {options_.session, config.start, config.end});
  if (!known) return known.error();
  const PlayedAs as{known->part, options_.config.writer};
  played_as_ = as;
  Result<std::unique_ptr<PlayedTape>> schedule = PlayedTape::open(options_.tape, as);
  if (!schedule) return schedule.error();
  Result<std::unique_ptr<PlayedTape>> writes =
      PlayedTape::open(options_.tape, as, PlayedTape::Select::compared);
  if (!writes) return writes.error();
  if (known->flaw) return *known->flaw;
  const bool small = is_small(options_.tape);
  const bool check_now = known->checkable && small;
  const std::optional<TapeCheck> checked = check_now ? check_tape(options_.tape) : std::nullopt;
  if (checked && checked->whole && !checked->found) return checked->found;
  Engine::TapeFacts& facts = known->facts;
  for (const std::string& file : {options_.report_file, options_.junit_file}) {
    if (file.empty()) continue;
    if (Result<void> place = check_report_place(file); !place) return place;
  }
  schedule_ = std::move(*schedule);
  writes_ = std::move(*writes);
  const std::optional<TapeHeader> header = schedule_->header();
  identity_ = header ? header->identity : std::nullopt;
  if (header && !header->identity_refused.empty())
    context_.log->error("{}: its identity is refused: {}", name(), header->identity_refused.for_line());
  datagrams_ = header && (header->transport ? *header->transport == Transport::datagram
                                            : header->device.raw().starts_with("udp"));
  facts.stamped_at_arrival =
      header && header->stamped ? *header->stamped == Stamped::arrival : schedule_->has_events();
  if (datagrams_ && Pieces(options_.config.chunks, 0).cut()) {
    return make_error(Errc::usage,
                      fmt::format("option 'chunks': tape '{}' is of datagrams, which come whole; leave it "
                                  "out",
                                  options_.tape.name()));
  }
  line_ = std::move(known->line);
  ended_ = known->ended;
  tape_doubts_ = doubts_of(*known);
  own_settings_ = settings_ = own_settings(line_, header);
  if (drives()) facts.totals.reset();  // what is compared is counted, and that may be less
  if (Result<void> there = check_start(*schedule_, known->last); !there) return there;
  if (options_.brief && facts.opens <= 1) context_.loop->file_events().begin_after(kBrief);
  if (const auto counted = small ? count_at_once(*schedule_, config.start) : std::nullopt)
    facts.totals = counted;
  reports_ =
      std::make_unique<ReplayReports>(context_,
                                      ReplayReports::Options{.tape = options_.tape,
                                                             .file = options_.report_file,
                                                             .junit_file = options_.junit_file,
                                                             .totals = facts.totals,
                                                             .as = as,
                                                             .start = config.start,
                                                             .unchecked = known->checkable && !check_now,
                                                             .group = options_.group},
                                      [this](const RunReport& report) { publish(report); });
  const bool has_place = options_.clock && known->zero;
  const Micros begin = has_place ? options_.clock->tape_begin(*known->zero) : Micros{};
  Result<Engine::Parts> given = parts(as);
  if (!given) return given.error();
  given->tape_begin = begin + (known->part.from - TapeTime{});
  engine_ = std::make_unique<Engine>(options_.config, facts, *schedule_, *writes_, *given);
  if (options_.start_paused) engine_->stand(context_.loop->now(), true);
  return {};
}

// Whether the tape has anything from the start on.
Result<void> ReplayPort::check_start(RecordSource& tape, TapeTime last_event) {
  const TapeTime start = options_.config.start;
  TapeTime last{};
  while (start > TapeTime{}) {
    const auto record = tape.next();
    if (!record) return record.error();
    if (!*record) {
      return make_error(Errc::usage,
                        fmt::format("option 'start' is {} s, and nothing of tape '{}' is there; accepted: a "
                                    "time before its end, 0 to {:.6f} s",
                                    seconds_of(start), options_.tape.name(), seconds_of(last)));
    }
    const bool is_block = (*record)->kind == RecordKind::read || (*record)->kind == RecordKind::write;
    if (is_block) last = (*record)->at;
    if (is_block && last >= start) break;
  }
  if (last_event > TapeTime{}) length_ = std::min(last_event, options_.config.end.value_or(last_event));
  return start > TapeTime{} ? tape.rewind() : Result<void>();
}

Result<Engine::Parts> ReplayPort::parts(const PlayedAs& as) {
  Engine::Parts parts{.expectation = options_.expectation.get(),
                      .clock = options_.clock.get(),
                      .half_closes = listener().half_closes()};
  const bool resyncs = options_.config.on_mismatch == OnMismatch::resync && !drives();
  if (options_.config.match == Match::sequence && !resyncs) return parts;
  if (drives()) {
    return make_error(Errc::usage,
                      "option 'match': a tape that plays the driver asks in its own order; leave it out");
  }
  Result<std::unique_ptr<PlayedTape>> index = PlayedTape::open(options_.tape, as);
  if (!index) return index.error();
  index_ = std::move(*index);
  Result<std::unique_ptr<TapeAnswers>> answers = TapeAnswers::open(options_.tape, as.part);
  if (!answers) return answers.error();
  answers_ = std::move(*answers);
  parts.index = index_.get();
  parts.answers = answers_.get();
  return parts;
}

void ReplayPort::open() {
  open_ = true;
  hand_on_held();
  if (!run_begun_) unread_.begin_run();
  unread_.begin_session();
  reports_->begin_count();
  if (drives()) return open_line();
  const Instant now = context_.loop->now();
  if (!run_begun_) run_begun_ = now;
  engine_->on_open(now);
  listener().on_up();
  pump();
}

void ReplayPort::close() {
  if (!open_) return;
  open_ = false;
  if (drives()) return;
  settings_ = own_settings_;
  end_drains();
  if (aftermath_) aftermath_->finish();
  unread_.close_session();
  hand_on_held();
  engine_->on_close(context_.loop->now());
  pump();
}

void ReplayPort::write(ByteView data) {
  if (aftermath_) aftermath_->write(data);
  if (context_.pulled) pump();
  last_heard_ = context_.loop->now();
  written_ += data.size();
  engine_->on_write(last_heard_, data);
  congested_ = engine_->backlog() > kMostBacklog;
  pump();
}

// A device that ends its sending where the tape has not even an end of it has ended its line.
bool ReplayPort::end_writing() {
  if (drives() && engine_->line_may_end() == false) return false;
  engine_->on_writing_ended(context_.loop->now());
  pump();
  return true;
}

void ReplayPort::set_reading(bool on) {
  last_heard_ = context_.loop->now();
  blocked_ = !on;
  if (on && std::exchange(coming_up_, false)) {
    if (!run_begun_) run_begun_ = last_heard_;
    engine_->on_open(last_heard_);
  }
  engine_->set_blocked(!on);
  if (on) pump();
}

bool ReplayPort::discard() {
  if (options_.config.timing == Timing::recorded || !schedule_ || !schedule_->has_events()) return false;
  dropping_ = true;
  pump();
  dropping_ = false;
  return true;
}

void ReplayPort::tell(const LineEvent& event) {
  const auto tell_engine = [this](const auto& tell) {
    tell(context_.loop->now());
    pump();
  };
  std::visit(LineVisitor{
                 [this](const line::Flush& flush) { driver_flushed(flush.queue); },
                 [&](const line::Settings& settings) {
                   tell_engine([&](Instant now) { engine_->on_settings(now, settings.seen); });
                 },
                 [&](const LineSignal& signal) {
                   if (!is_output(signal.name) && signal.name != LineSignal::Name::brk)
                     return;  // shown to the driver only
                   tell_engine([&](Instant now) { engine_->on_signal(now, signal); });
                 },
                 [this](const line::Drain& drain) { begin_drain(drain.number); },
                 [this](const line::LeftUnread& left) { unread_.told(left); },
                 [this](const line::Refused& refused) {
                   ++refused_;
                   refused_bytes_ += refused.bytes;
                 },
                 [this](const LineFault& fault) { note_fault(fault); },
                 [this](const line::WatchSignals& watch) {
                   if (engine_) engine_->show_signals(watch.on);
                 },
                 [this](const auto& other) { Port::tell(other); },
             },
             event);
}

void ReplayPort::driver_flushed(FlushQueue queue) {
  if (queue != FlushQueue::out) unread_.flushed();
  if (!schedule_->has_events()) return;
  if (queue != FlushQueue::in) output_flushes_.add(written_);
  if (queue == FlushQueue::out) return;
  engine_->on_flush(context_.loop->now());
  pump();
}

void ReplayPort::begin_drain(RequestNumber number) {
  const std::vector<Micros>& recorded = line_.drains();
  const std::size_t index = drains_begun_++;
  if (index >= recorded.size() || options_.config.timing == Timing::none)
    return listener().told(line::Sent{number});
  const std::chrono::duration<double, std::micro> lasts = recorded[index] / options_.config.rate;
  drains_.push_back(number);
  drain_timer_.set_after(std::chrono::duration_cast<Nanos>(lasts));
}

void ReplayPort::end_drains() {
  drain_timer_.cancel();
  for (const RequestNumber number : std::exchange(drains_, {})) listener().told(line::Sent{number});
}

void ReplayPort::note_fault(const LineFault& fault) {
  if (fault.kind == LineFault::kPlan) {
    faults_ = {.plan = fault.spec.raw(), .seed = fault.seed.value_or(0)};
  } else if (faults_) {
    faults_->add(fault);
  }
}

Result<void> ReplayPort::apply(const LineSettings& settings) {
  if (drives()) return {};  // what the driver found is on the tape
  if (!settings_) return Port::apply(settings);
  const std::optional<SeenSettings> answer = line_.taken_for(settings);
  if (answer && answer->over(*settings_) == *settings_) {
    return make_error(Errc::usage, fmt::format("{}: on the tape the device did not take {}", name(),
                                               to_text(SeenSettings::of(settings))));
  }
  settings_ = answer ? answer->over(settings) : settings;
  if (settings_ != settings) listener().told(line::Settings{SeenSettings::of(*settings_)});
  return {};
}

Result<void> ReplayPort::request(const PlaybackRequest& what) {
  using Kind = PlaybackRequest::Kind;
  const auto refused = [](std::string why) { return make_error(Errc::usage, std::move(why)); };
  if (!engine_) return refused("the tape is not open yet");
  if (options_.clock) return refused("it plays by a clock that other tapes have, too");
  const Instant now = context_.loop->now();
  const bool stands = engine_->playing(now).stands;
  const bool moves = what.kind == Kind::seek || what.kind == Kind::step;
  if (moves && index_) return refused("the tape's requests are looked up, whose order is the driver's");
  if (moves && drives()) return refused("it plays the driver, whose line has its own course");
  switch (what.kind) {
    case Kind::pause:
    case Kind::resume:
      engine_->stand(now, what.kind == Kind::pause);
      break;
    case Kind::step:
      if (!stands) return refused("it is not paused; pause it first");
      if (!open_) return refused("no driver has the port open: there is nothing to step through");
      engine_->step(now, what.exchanges);
      break;
    case Kind::seek:
      if (Result<void> good = check_seek(what.to); !good) return good;
      engine_->seek(now, TapeTime{what.to});
      break;
    case Kind::rate:
      engine_->set_rate(now, what.rate);
      break;
  }
  pump();
  return {};
}

Result<void> ReplayPort::check_seek(Micros to) const {
  if (!open_) {
    return make_error(Errc::usage,
                      "no driver has the port open: it begins at the start with its driver's open");
  }
  const TapeTime at{to};
  const TapeTime first = options_.config.start;
  const std::optional<TapeTime> last = length_ ? length_ : options_.config.end;
  if (at >= first && (!last || at <= *last)) return {};
  return make_error(
      Errc::usage,
      fmt::format("seek: {} s is not on what is played of the tape; accepted: {} to {} s", seconds_of(at),
                  seconds_of(first), last ? fmt::format("{}", seconds_of(*last)) : "the tape's end"));
}

PlaybackStatus ReplayPort::playback() {
  PlaybackStatus status;
  status.paused = options_.start_paused;
  status.rate = options_.config.rate;
  status.loops = options_.config.loops == 0 ? std::nullopt : std::optional(options_.config.loops);
  if (length_) status.length = length_->time_since_epoch();
  if (!engine_) return status;
  const Engine::Playing playing = engine_->playing(context_.loop->now());
  status.paused = playing.stands;
  status.rate = playing.rate;
  status.loop = playing.loop;
  if (playing.position) status.position = playing.position->time_since_epoch();
  return status;
}

std::string ReplayPort::awaits() {
  const auto unsent = engine_ ? engine_->first_unsent() : std::nullopt;
  if (!unsent) return {};
  return fmt::format("the tape goes on after a write of \"{}\" (offset {}, recorded at {:.6f} s)",
                     to_printable(unsent->bytes), unsent->offset,
                     static_cast<double>(to_us(unsent->at)) / 1e6);
}

// A program that was busy elsewhere finds what fell due meanwhile as if it had come in time.
Instant ReplayPort::pump_time(Instant now) const {
  const std::optional<Instant> due = engine_->next_deadline();
  return context_.pulled && due && *due < now ? *due : now;
}

void ReplayPort::pump() {
  const Instant now = context_.loop->now();
  int steps = 0;
  if (engine_->holds_piece() && listener().unread() == 0) engine_->on_taken(now);
  for (bool due = true; due;) {
    const Instant at = context_.pulled ? pump_time(now) : context_.loop->now();
    ReplayActions actions = engine_->advance(at);
    const bool empty = actions.empty();
    perform(actions);
    const std::optional<Instant> next = engine_->next_deadline();
    reading_on_ = next && *next <= at;
    due = !empty || (context_.pulled && next && *next <= now && ++steps < kMostSteps);
  }
  set_timer();
  if (drives()) watch_silence();
  if (congested_ && engine_->backlog() <= kMostBacklog / 2) {
    congested_ = false;
    listener().on_drained();
  }
  if (finish_timer_) continue_finish();
}

// Bytes and signals in their order.
void ReplayPort::deliver(const ReplayActions& actions) {
  const ByteView all(actions.deliver);
  if (!all.empty() && !dropping_) unread_.delivered();
  std::size_t done = 0;
  const auto deliver_to = [&](std::size_t end) {
    if (end <= done || dropping_) return;
    std::vector<std::size_t> ends;
    for (const std::size_t each : actions.block_ends) {
      if (each > done) ends.push_back(std::min(each, end) - done);
      if (each >= end) break;
    }
    listener().on_arrivals(all.subspan(done, end - done), ends);
    done = end;
  };
  for (const ReplayActions::Signal& each : actions.signals) {
    deliver_to(each.behind);
    listener().told(each.signal);
  }
  if (actions.signals.empty() && !all.empty() && !dropping_)
    return listener().on_arrivals(all, actions.block_ends);
  deliver_to(all.size());
}

void ReplayPort::perform(ReplayActions& actions) {
  deliver(actions);
  if (actions.line_step) do_step(*actions.line_step);
  if (actions.end_sending) (void)listener().on_ended();
  for (const Mismatch& mismatch : actions.mismatches) {
    context_.log->warn("{}: {}", options_.tape.name(), to_text(mismatch, options_.config.writer));
  }
  if (actions.hang_up && drives()) {
    close_line(LineDown::Reason::hung_up);
  } else if (actions.hang_up) {
    hang_up_driver(actions);
  }
  for (const Mismatch& mismatch : actions.mismatches) reports_->look_for_hint(mismatch);
  const bool exit = actions.exit;
  const std::string trouble = actions.run_ended ? actions.run_ended->trouble.value_or("") : "";
  if (actions.run_ended) take_report(std::move(*actions.run_ended));
  if (exit && any_run_) listener().on_finished(exit_status::kPass);  // the verdict's comes with on_complete
  if (!trouble.empty() && !drives()) {
    listener().on_down({.reason = LineDown::Reason::lost,
                        .error = make_error(Errc::damaged_tape, trouble),
                        .after_reading = true});
  }
}

// Once: the line is there for as long as the tape goes on.
void ReplayPort::open_line() {
  last_heard_ = context_.loop->now();
  line_open_ = coming_up_ = blocked_ = true;
  const bool sets = own_settings_ && !options_.keeps_line;
  if (sets) listener().told(line::Settings{SeenSettings::of(*own_settings_)});
  listener().on_up();
  watch_silence();
}

void ReplayPort::close_line(LineDown::Reason reason) {
  if (!std::exchange(line_open_, false)) return;
  coming_up_ = false;
  listener().on_down({.reason = reason, .error = {}});
}

void ReplayPort::do_step(const LineStep& step) {
  switch (step.kind) {
    case LineStep::Kind::open:
      return open_line();
    case LineStep::Kind::close:
      return close_line(LineDown::Reason::closed);
    case LineStep::Kind::settings:
      return listener().told(line::Settings{step.settings});
    case LineStep::Kind::signal:
      return listener().told(step.signal);
    case LineStep::Kind::flush:
      return listener().told(line::Flush{step.queue.value_or(FlushQueue::both)});
  }
}

void ReplayPort::hang_up(bool) {
  if (!line_open_) return;
  close_line(LineDown::Reason::hung_up);
  ended_because_ = "the device ended the line, and the tape goes on";
  engine_->on_line_ended(context_.loop->now());
  pump();
  ended_because_.clear();
}

// While nothing goes on by itself, the device is waited for.
void ReplayPort::watch_silence() {
  const bool waits_for_line = coming_up_ && !options_.waits_for_line;
  const bool waits = waits_for_line || (run_begun_ && !coming_up_ && !engine_->next_deadline());
  if (!options_.silence || !waits || finish_timer_) return silence_timer_.cancel();
  const auto unsent = coming_up_ ? std::nullopt : engine_->first_unsent();
  const Instant since = unsent ? std::max(last_heard_, unsent->due) : last_heard_;
  silence_timer_.set(since + *options_.silence);
}

void ReplayPort::end_silence() {
  const double limit = std::chrono::duration<double>(*options_.silence).count();
  if (coming_up_) {
    context_.log->error("the device's line did not come up within {:g} s", limit);
    close_line(LineDown::Reason::closed);
    return listener().on_finished(exit_status::kDevice);
  }
  ended_because_ = blocked_ ? fmt::format("the device's line took nothing for {:g} s", limit)
                            : fmt::format("the device was silent for {:g} s", limit);
  engine_->finish(context_.loop->now());
  pump();
}

// At the tape's end and where it hangs up, the driver reads what is left first; at a mismatch that fails the
// run the line breaks where it stands.
void ReplayPort::hang_up_driver(ReplayActions& actions) {
  const bool failed = options_.config.on_mismatch == OnMismatch::fail &&
                      (!actions.mismatches.empty() || (actions.run_ended && actions.run_ended->mismatch));
  LineDown down{.reason = LineDown::Reason::hung_up, .error = {}, .after_reading = !failed};
  if (failed && !actions.mismatches.empty())
    down.error.message = to_text(actions.mismatches.front(), options_.config.writer);
  const bool look_on = options_.looks_on && open_ && failed && actions.run_ended &&
                       actions.run_ended->mismatch &&
                       actions.run_ended->mismatch->kind != MismatchKind::timing;
  if (!look_on) return listener().on_down(down);
  actions.mismatches.clear();
  aftermath_ = std::make_unique<Aftermath>(
      context_, Aftermath::Tape{options_.tape, played_as_}, *std::exchange(actions.run_ended, std::nullopt),
      Aftermath::Calls{.deliver = [this](ByteView answer) { listener().on_data(answer); },
                       .done = [this, down](RunReport report) { end_aftermath(std::move(report), down); }});
}

void ReplayPort::end_aftermath(RunReport report, const LineDown& down) {
  reports_->look_for_hint(*report.mismatch);
  if (open_) listener().on_down(down);
  take_report(std::move(report));
}

void ReplayPort::take_report(RunReport report) {
  any_run_ = true;
  drains_begun_ = 0;
  const Instant now = context_.loop->now();
  report.nobody_came = !run_begun_;
  const Instant begun = std::exchange(run_begun_, std::nullopt).value_or(now);
  report.tape = options_.tape.name();
  report.connection = options_.connection;
  report.when = wall_text(begun, context_.loop->clock());
  if (report.nobody_came) report.sessions_made = 0;
  if (options_.session > 0) report.session = options_.session;
  report.faults = faults_;
  if (faults_) faults_ = {.plan = faults_->plan, .seed = faults_->seed};
  if (!report.nobody_came)
    report.doubts.insert(report.doubts.end(), tape_doubts_.begin(), tape_doubts_.end());
  if (const auto torn = ended_ ? std::nullopt : schedule_->torn_tail(); torn && !report.nobody_came)
    report.doubts.push_back({Doubt::Kind::gap, *torn + ": what came last may be missing"});
  add_output_flushes(report);
  add_stalls(report, begun);
  if (report.verdict != Verdict::pass) report.outcome = std::exchange(ended_because_, {});
  const bool look = is_look(report);
  const bool waits =
      open_ && !drives() && !report.closed && report.verdict == Verdict::pass && !finish_timer_;
  if (waits) {
    held_ = std::move(report);
  } else {
    hand_on(std::move(report));
  }
  // The verdict's status comes with on_complete.
  const bool is_end = drives() || (options_.once && !look);
  if (drives()) close_line(LineDown::Reason::closed);
  if (!is_end) return;
  options_.ends_with_run = true;
  listener().on_finished(exit_status::kPass);
}

// How much its drivers left unread is known by now, or never will be.
void ReplayPort::hand_on(RunReport report) {
  unread_.add_to(report);
  if (auto refused = take_refused()) report.doubts.push_back(std::move(*refused));
  reports_->add(std::move(report));
}

void ReplayPort::hand_on_held() {
  if (held_) hand_on(*std::exchange(held_, std::nullopt));
}

// What nobody has judged.
std::optional<Doubt> ReplayPort::take_refused() {
  const std::uint64_t others = std::exchange(refused_, 0);
  const std::uint64_t bytes = std::exchange(refused_bytes_, 0);
  if (others == 0) return std::nullopt;
  return Doubt{
      Doubt::Kind::refused,
      fmt::format(
          "{} came while the driver was there and {} turned away: {} bytes that {} had written are on no "
          "tape (see --connections)",
          others == 1 ? "another connection" : fmt::format("{} other connections", others),
          others == 1 ? "was" : "were", bytes, others == 1 ? "it" : "they")};
}

// What was written just before one of them came or was dropped, as it chanced.
void ReplayPort::add_output_flushes(RunReport& report) {
  const std::uint64_t flushes = std::exchange(output_flushes_, {}).count();
  written_ = 0;
  if (flushes <= report.output_flushes) return;
  const std::uint64_t more = flushes - report.output_flushes;
  report.doubts.push_back(
      {Doubt::Kind::flushed,
       fmt::format(
           "the driver dropped what it had written (tcflush) {} more often than on the tape: whether all of "
           "it had been read before nobody knows",
           more == 1 ? "once" : fmt::format("{} times", more))});
}

void ReplayPort::add_stalls(RunReport& report, Instant begun) const {
  const std::string_view open =
      report.writer == Writer::driver ? "the driver's open" : roles_of(report.writer).open;
  const std::vector<Stall> stalls = context_.loop->stalls_since(begun);
  for (const Stall& stall : stalls) {
    const auto after = std::chrono::duration<double>(stall.begin - begun).count();
    const auto length = std::chrono::duration<double, std::milli>(stall.length).count();
    report.doubts.push_back(
        {Doubt::Kind::stall,
         fmt::format(
             "this machine or program stood still for {:.0f} ms, {:.3f} s after {}: what came late, or "
             "too late, may be its doing",
             length, std::max(after, 0.0), open)});
  }
}

void ReplayPort::publish(const RunReport& report) {
  report_ = report;
  if (is_look(report)) {
    context_.log->info("{}: the driver wrote nothing, and the tape has writes: a look, and no run",
                       options_.tape.name());
  } else if (!report.nobody_came) {
    std::string text = to_text(report);
    if (text.ends_with('\n')) text.pop_back();
    context_.log->info("{}", text);
  }
  if (options_.on_report) options_.on_report(report);
}

int ReplayPort::status() const {
  const std::optional<RunReport>& worst = reports_->runs().worst();
  const int verdict = worst ? exit_status_of(*worst) : exit_status::kPass;
  return verdict == exit_status::kPass && report_failed_ ? exit_status::kRuntime : verdict;
}

bool ReplayPort::may_spin(Instant due) const {
  const bool comes_by_itself = context_.loop->clock().machine_time(due).has_value();
  return comes_by_itself && due - context_.loop->last_spin() >= kSpin * kSpinShare;
}

void ReplayPort::set_timer() {
  const std::optional<Instant> due = engine_->next_deadline();
  if (!due) return timer_.cancel();
  if (reading_on_) return timer_.set_after(kPause);
  if (engine_->holds_piece()) return timer_.set(std::min(*due, context_.loop->now() + kLook));
  timer_.set(may_spin(*due) ? *due - kSpin : *due);
}

void ReplayPort::on_timer() {
  if (const std::optional<Instant> due = engine_->next_deadline()) {
    const Instant now = context_.loop->now();
    if (*due > now && *due - now <= kSpin) {
      if (!may_spin(*due)) return timer_.set(*due);  // another tape has meanwhile
      while (context_.loop->now() < *due) {
      }
      context_.loop->spun_until(*due);
    }
  }
  pump();
}

void ReplayPort::finish() {
  if (!engine_) return listener().on_complete(0);
  if (aftermath_) aftermath_->finish();
  if (held_ && open_) unread_.close_session();
  hand_on_held();
  if (any_run_ && !run_begun_ && !options_.group) {
    if (auto refused = take_refused()) reports_->add_late_doubt(std::move(*refused));
  }
  const Instant now = context_.loop->now();
  // That no driver has come is a verdict too, but of no interest to a program that has the port to itself.
  if (!context_.pulled && !any_run_ && !run_begun_) engine_->on_open(now);
  options_.once = false;  // the session is ending already
  finish_limit_ = now + (options_.ends_with_run ? kFinishLimit : kAskedFinishLimit);
  finish_timer_.emplace(*context_.loop, [this] {
    engine_->give_up(context_.loop->now());
    pump();
  });
  finish_timer_->set(now + (options_.ends_with_run ? kReadOnLimit : kAskedReadOnLimit));
  engine_->finish(now);
  pump();
}

// Once the engine has ended its run, the reports are waited for.
void ReplayPort::continue_finish() {
  if (!engine_->finished()) return;
  timer_.cancel();
  finish_timer_.reset();
  reports_->finish(finish_limit_, [this](bool written) {
    report_failed_ = !written;
    if (any_run_) context_.log->info("{}: {}", options_.tape.name(), reports_->runs().text());
    listener().on_complete(status());
  });
}

}  // namespace porttape
