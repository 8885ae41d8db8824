#include "libport/taped/replay_port.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>

#include "libport/loop/file_events.hpp"
#include "libport/replay/seconds_text.hpp"
#include "libport/taped/report_file.hpp"

namespace porttape {
namespace {

// Timers wake 20 to 100 µs late; the rest of the way is spun, which is late by less than a microsecond.
constexpr Nanos kSpin = std::chrono::microseconds(120);
constexpr Nanos kBrief = std::chrono::milliseconds(30);
// Of what the peer wrote and the engine has not looked at: beyond, it is not read on.
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

}  // namespace

ReplayPort::ReplayPort(const PortContext& context, ReplayOptions options)
    : context_(context),
      options_(std::move(options)),
      notes_(*context.loop),
      timer_(*context.loop, [this] { on_timer(); }) {
  if (!options_.clock) options_.clock = context_.replay_clock;
}

ReplayPort::~ReplayPort() = default;

Result<void> ReplayPort::prepare() {
  for (const std::string& file : {options_.report_file, options_.junit_file}) {
    if (file.empty()) continue;
    if (Result<void> place = check_report_place(file); !place) return place;
  }
  Result<ReplaySources> opened = ReplaySources::open(options_);
  if (!opened) return opened.error();
  const ReplaySources& sources = sources_.emplace(*std::move(opened));
  const std::optional<TapeHeader>& header = sources.header;
  if (header && !header->identity_refused.empty())
    context_.log->error("{}: its identity is refused: {}", name(), header->identity_refused.for_line());
  if (options_.brief && sources.facts.opens <= 1) context_.loop->file_events().begin_after(kBrief);
  reports_ = std::make_unique<ReplayReports>(context_,
                                             ReplayReports::Options{.tape = options_.tape,
                                                                    .file = options_.report_file,
                                                                    .junit_file = options_.junit_file,
                                                                    .totals = sources.facts.totals,
                                                                    .as = sources.as,
                                                                    .start = options_.config.start,
                                                                    .unchecked = sources.unchecked,
                                                                    .group = options_.group},
                                             [this](const RunReport& report) { publish(report); });
  const bool has_place = options_.clock && sources.zero;
  const Micros begin = has_place ? options_.clock->tape_begin(*sources.zero) : Micros{};
  engine_ = std::make_unique<Engine>(options_.config, sources.facts, *sources.schedule, *sources.writes,
                                     Engine::Parts{.expectation = options_.expectation.get(),
                                                   .clock = options_.clock.get(),
                                                   .tape_begin = begin + (sources.as.part.from - TapeTime{}),
                                                   .index = sources.index.get(),
                                                   .answers = sources.answers.get(),
                                                   .half_closes = listener().half_closes()});
  if (options_.start_paused) engine_->stand(now(), true);
  return {};
}

std::optional<PortIdentity> ReplayPort::identity() const {
  return sources_ && sources_->header ? sources_->header->identity : std::nullopt;
}

void ReplayPort::begin_session() {
  open_ = true;
  notes_.open();
  reports_->begin_count();
}

void ReplayPort::begin_run(Instant now) {
  notes_.begin(now);
  engine_->on_open(now);
}

void ReplayPort::write(ByteView data) {
  if (context_.pulled) pump();
  notes_.written(data.size());
  engine_->on_write(now(), data);
  congested_ = engine_->backlog() > kMostBacklog;
  pump();
}

bool ReplayPort::end_writing() {
  engine_->on_writing_ended(now());
  pump();
  return true;
}

void ReplayPort::set_reading(bool on) {
  engine_->set_blocked(!on);
  if (on) pump();
}

void ReplayPort::tell(const LineEvent& event) {
  const auto tell_engine = [this, &event] {
    engine_->on_event(now(), event);
    pump();
  };
  std::visit(LineVisitor{
                 [this](const line::Flush& flush) { flushed(flush); },
                 [&](const line::Settings&) { tell_engine(); },
                 [&](const LineSignal& signal) {
                   if (!is_output(signal.name) && signal.name != LineSignal::Name::brk)
                     return;  // shown to the driver only
                   tell_engine();
                 },
                 [this](const line::LeftUnread& left) { notes_.left_unread(left); },
                 [this](const line::Refused& refused) { notes_.refused(refused); },
                 [this](const LineFault& fault) { notes_.fault(fault); },
                 [this](const line::WatchSignals& watch) {
                   if (engine_) engine_->show_signals(watch.on);
                 },
                 [this](const auto& other) { Port::tell(other); },
             },
             event);
}

void ReplayPort::flushed(const line::Flush& flush) {
  if (flush.queue != FlushQueue::out) notes_.input_flushed();
  if (!sources_->schedule->has_events()) return;
  if (flush.queue != FlushQueue::in) notes_.output_flushed();
  if (flush.queue == FlushQueue::out) return;
  engine_->on_event(now(), flush);
  pump();
}

Result<void> ReplayPort::request(const PlaybackRequest& what) {
  using Kind = PlaybackRequest::Kind;
  const auto refused = [](std::string why) { return make_error(Errc::usage, std::move(why)); };
  if (!engine_) return refused("the tape is not open yet");
  if (options_.clock) return refused("it plays by a clock that other tapes have, too");
  const Instant at = now();
  const bool stands = engine_->playing(at).stands;
  const bool moves = what.kind == Kind::seek || what.kind == Kind::step;
  if (std::string why = moves ? why_in_order() : ""; !why.empty()) return refused(std::move(why));
  switch (what.kind) {
    case Kind::pause:
    case Kind::resume:
      engine_->stand(at, what.kind == Kind::pause);
      break;
    case Kind::step:
      if (!stands) return refused("it is not paused; pause it first");
      if (!open_) return refused("no driver has the port open: there is nothing to step through");
      engine_->step(at, what.exchanges);
      break;
    case Kind::seek:
      if (Result<void> good = check_seek(what.to); !good) return good;
      engine_->seek(at, TapeTime{what.to});
      break;
    case Kind::rate:
      engine_->set_rate(at, what.rate);
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
  const std::optional<TapeTime> last = sources_->length ? sources_->length : options_.config.end;
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
  if (sources_ && sources_->length) status.length = sources_->length->time_since_epoch();
  if (!engine_) return status;
  const Engine::Playing playing = engine_->playing(now());
  status.paused = playing.stands;
  status.rate = playing.rate;
  status.loop = playing.loop;
  if (playing.position) status.position = playing.position->time_since_epoch();
  return status;
}

// A program that was busy elsewhere finds what fell due meanwhile as if it had come in time.
Instant ReplayPort::pump_time(Instant now) const {
  const std::optional<Instant> due = engine_->next_deadline();
  return context_.pulled && due && *due < now ? *due : now;
}

void ReplayPort::pump() {
  const Instant begin = now();
  int steps = 0;
  if (engine_->holds_piece() && listener().unread() == 0) engine_->on_taken(begin);
  for (bool due = true; due;) {
    const Instant at = context_.pulled ? pump_time(begin) : now();
    ReplayActions actions = engine_->advance(at);
    const bool empty = actions.empty();
    perform(actions);
    const std::optional<Instant> next = engine_->next_deadline();
    reading_on_ = next && *next <= at;
    due = !empty || (context_.pulled && next && *next <= begin && ++steps < kMostSteps);
  }
  set_timer();
  pumped();
  if (congested_ && engine_->backlog() <= kMostBacklog / 2) {
    congested_ = false;
    listener().on_drained();
  }
  if (finish_timer_) continue_finish();
}

void ReplayPort::drop_due() {
  dropping_ = true;
  pump();
  dropping_ = false;
}

// Bytes and events in their order.
void ReplayPort::deliver(const ReplayActions& actions) {
  const ByteView all(actions.deliver);
  if (!all.empty() && !dropping_) notes_.delivered();
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
  for (const ReplayActions::Told& each : actions.events) {
    deliver_to(each.behind);
    listener().told(each.event);
  }
  if (actions.events.empty() && !all.empty() && !dropping_)
    return listener().on_arrivals(all, actions.block_ends);
  deliver_to(all.size());
}

void ReplayPort::perform(ReplayActions& actions) {
  deliver(actions);
  if (actions.line_step) step_line(*actions.line_step);
  if (actions.end_sending) (void)listener().on_ended();
  for (const Mismatch& mismatch : actions.mismatches) {
    context_.log->warn("{}: {}", options_.tape.name(), to_text(mismatch, options_.config.writer));
  }
  if (actions.hang_up) break_line(actions);
  for (const Mismatch& mismatch : actions.mismatches) reports_->look_for_hint(mismatch);
  const bool exit = actions.exit;
  const std::string trouble = actions.run_ended ? actions.run_ended->trouble.value_or("") : "";
  if (actions.run_ended) take_report(std::move(*actions.run_ended));
  if (exit && any_run_) listener().on_finished(exit_status::kPass);  // the verdict's comes with on_complete
  if (!trouble.empty()) tape_lost(trouble);
}

void ReplayPort::take_report(RunReport report) {
  any_run_ = true;
  report.tape = options_.tape.name();
  report.connection = options_.connection;
  if (options_.session > 0) report.session = options_.session;
  notes_.end_run(report, sources_->doubts_of_run());
  run_ended(std::move(report));
}

void ReplayPort::hand_on(RunReport report) {
  notes_.add_left(report);
  reports_->add(std::move(report));
}

// The verdict's status comes with on_complete.
void ReplayPort::ask_for_end() {
  options_.ends_with_run = true;
  listener().on_finished(exit_status::kPass);
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
  if (engine_->holds_piece()) return timer_.set(std::min(*due, now() + kLook));
  timer_.set(may_spin(*due) ? *due - kSpin : *due);
}

void ReplayPort::on_timer() {
  if (const std::optional<Instant> due = engine_->next_deadline()) {
    const Instant begin = now();
    if (*due > begin && *due - begin <= kSpin) {
      if (!may_spin(*due)) return timer_.set(*due);  // another tape has meanwhile
      while (now() < *due) {
      }
      context_.loop->spun_until(*due);
    }
  }
  pump();
}

void ReplayPort::finish() {
  if (!engine_) return listener().on_complete(0);
  if (any_run_ && !notes_.begun() && !options_.group) {
    if (auto refused = notes_.take_refused()) reports_->add_late_doubt(std::move(*refused));
  }
  const Instant begin = now();
  // That no peer has come is a verdict too, but of no interest to a program that has the port to itself.
  if (!context_.pulled && !any_run_ && !notes_.begun()) engine_->on_open(begin);
  options_.once = false;  // the session is ending already
  finish_limit_ = begin + (options_.ends_with_run ? kFinishLimit : kAskedFinishLimit);
  finish_timer_.emplace(*context_.loop, [this] {
    engine_->give_up(now());
    pump();
  });
  finish_timer_->set(begin + (options_.ends_with_run ? kReadOnLimit : kAskedReadOnLimit));
  engine_->finish(begin);
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
