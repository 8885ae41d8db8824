#include "libport/taped/replay_port.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>

#include "libport/loop/file_events.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/tape_count.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/taped/report_file.hpp"

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
// The end: how long the engine may read on, and all may take.
constexpr Nanos kReadOnLimit = std::chrono::seconds(3);
constexpr Nanos kFinishLimit = std::chrono::seconds(5);
// A program that waits in a call gets what is due in one go, up to so many steps.
constexpr int kMostSteps = 1024;
// Spinning takes at most this part of a core for all tapes together, else dense ones would keep it from the
// drivers.
constexpr int kSpinShare = 5;

struct Known {
  Engine::TapeFacts facts;
  std::optional<TapeZero> zero;
  TapePart part;
};

void add_fact(const TapeEvent& told, const SessionSearch& search, Engine::TapeFacts& facts) {
  const auto& [at, event] = told;
  if (const auto* end = std::get_if<event::End>(&event); end && end->read && end->write) {
    facts.totals = TapeTotals{end->read->bytes, end->write->bytes};
  }
  if (!search.inside()) return;
  if (const auto* lost = std::get_if<event::DeviceLost>(&event); lost && lost->hung_up) {
    facts.hang_ups.push_back(at);
  }
  if (const auto* gap = std::get_if<event::Gap>(&event)) {
    facts.gaps.push_back({gap->from.value_or(TapeTime{}), at, gap->bytes, gap->why});
  }
}

// Of a part alone, counted from its beginning.
void keep_part(const TapePart& part, Engine::TapeFacts& facts) {
  if (part.whole()) return;
  facts.opens = 1;
  facts.totals.reset();
  for (TapeTime& at : facts.hang_ups) at = part.shifted(at);
  for (TapeGap& gap : facts.gaps) {
    gap.from = part.shifted(std::max(gap.from, part.from));
    gap.to = part.shifted(gap.to);
  }
}

Error no_such_session(const TapePaths& tape, std::uint64_t session, std::uint64_t sessions) {
  return make_error(Errc::usage,
                    fmt::format("option 'session': tape '{}' has {} session{}, and no number {}; `porttape "
                                "info` lists them",
                                tape.name(), sessions, sessions == 1 ? "" : "s", session));
}

// What is to be known of a tape beforehand. The events file is small, so that it may be read through.
Result<Known> known_of(const TapePaths& tape, std::uint64_t session) {
  Known known;
  Engine::TapeFacts& facts = known.facts;
  SessionSearch search(session);
  std::error_code unknown;
  if (std::filesystem::exists(tape.events, unknown)) {
    Result<std::unique_ptr<FileSource>> source = FileSource::open(tape.events);
    if (!source) return source.error();
    Result<EventFile> events = EventFile::create(std::move(*source));
    if (!events) return events.error();
    EventFile::Step step{};
    while ((step = events->next()) == EventFile::Step::event) {
      const TapeEvent& told = events->event();
      if (std::holds_alternative<event::Open>(told.what)) search.on_open(told.at);
      add_fact(told, search, facts);
      if (std::holds_alternative<event::Close>(told.what)) search.on_close(told.at);
    }
    if (step == EventFile::Step::failed) return events->error();
    if (const auto& header = events->header()) known.zero = header->zero;
  }
  facts.opens = search.opens();
  const std::optional<TapePart> part = search.found();
  if (!part) return no_such_session(tape, session, std::max<std::uint64_t>(1, search.opens()));
  known.part = *part;
  keep_part(known.part, facts);
  return known;
}

// What a tape holds that is counted in no time; nothing for a larger one.
std::optional<TapeTotals> count_small(const TapePaths& paths, RecordSource& tape) {
  std::uintmax_t size = 0;
  for (const auto& path : {paths.read, paths.write}) {
    std::error_code absent;
    const std::uintmax_t bytes = std::filesystem::file_size(path, absent);
    if (!absent) size += bytes;
  }
  if (size > kSmallTape) return std::nullopt;
  const std::optional<TapeTotals> totals = count_tape(tape);
  return tape.rewind() ? totals : std::nullopt;
}

}  // namespace

ReplayPort::ReplayPort(const PortContext& context, Options options)
    : context_(context), options_(std::move(options)), timer_(*context.loop, [this] { on_timer(); }) {
  if (!options_.clock) options_.clock = context_.replay_clock;
}

ReplayPort::~ReplayPort() = default;

Result<void> ReplayPort::prepare() {
  Result<TapeReader> schedule = TapeReader::open(options_.tape);
  if (!schedule) return schedule.error();
  Result<TapeReader> writes = TapeReader::open(options_.tape, TapeReader::Select::writes_only);
  if (!writes) return writes.error();
  Result<Known> known = known_of(options_.tape, options_.session);
  if (!known) return known.error();
  Engine::TapeFacts& facts = known->facts;
  if (!options_.report_file.empty()) {
    if (Result<void> place = check_report_place(options_.report_file); !place) return place;
  }
  schedule_ = std::move(*schedule);
  writes_ = std::move(*writes);
  const std::optional<TapeHeader> header = schedule_->header();
  datagrams_ = header && (header->transport ? *header->transport == Transport::datagram
                                            : header->device.starts_with("udp"));
  facts.stamped_at_arrival =
      header && header->stamped ? *header->stamped == Stamped::arrival : schedule_->has_events();
  RecordSource* played = &*schedule_;
  RecordSource* played_writes = &*writes_;
  if (!known->part.whole()) {
    played = &schedule_part_.emplace(*schedule_, known->part);
    played_writes = &writes_part_.emplace(*writes_, known->part);
  }
  if (options_.brief && facts.opens <= 1) context_.loop->file_events().begin_after(kBrief);
  if (const auto counted = count_small(options_.tape, *played)) facts.totals = counted;
  reports_ = std::make_unique<ReplayReports>(
      context_,
      ReplayReports::Options{options_.tape, options_.report_file, facts.totals, known->part, options_.group},
      [this](const RunReport& report) { publish(report); });
  const bool has_place = options_.clock && known->zero;
  const Micros begin = has_place ? options_.clock->tape_begin(*known->zero) : Micros{};
  engine_ = std::make_unique<Engine>(options_.config, facts, *played, *played_writes,
                                     Engine::Parts{.expectation = options_.expectation.get(),
                                                   .clock = options_.clock.get(),
                                                   .tape_begin = begin + (known->part.from - TapeTime{}),
                                                   .half_closes = listener().half_closes()});
  return {};
}

void ReplayPort::open() {
  open_ = true;
  reports_->begin_count();
  const Instant now = Loop::now();
  if (!run_begun_) run_begun_ = now;
  engine_->on_open(now);
  listener().on_up();
  pump();
}

void ReplayPort::close() {
  if (!open_) return;
  open_ = false;
  engine_->on_close(Loop::now());
  pump();
}

void ReplayPort::write(ByteView data) {
  if (context_.pulled) pump();
  engine_->on_write(Loop::now(), data);
  congested_ = engine_->backlog() > kMostBacklog;
  pump();
}

bool ReplayPort::end_writing() {
  engine_->on_writing_ended(Loop::now());
  pump();
  return true;
}

void ReplayPort::set_reading(bool on) {
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

void ReplayPort::peer_flushed(FlushQueue queue) {
  if (queue == FlushQueue::out || !schedule_->has_events()) return;
  engine_->on_flush(Loop::now());
  pump();
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
  const Instant now = Loop::now();
  int steps = 0;
  for (bool due = true; due;) {
    const Instant at = context_.pulled ? pump_time(now) : Loop::now();
    ReplayActions actions = engine_->advance(at);
    const bool empty = actions.empty();
    perform(actions);
    const std::optional<Instant> next = engine_->next_deadline();
    reading_on_ = empty && next && *next <= at;
    due = !empty || (context_.pulled && next && *next <= now && ++steps < kMostSteps);
  }
  set_timer();
  if (congested_ && engine_->backlog() <= kMostBacklog / 2) {
    congested_ = false;
    listener().on_drained();
  }
  if (finish_timer_) continue_finish();
}

void ReplayPort::perform(ReplayActions& actions) {
  if (!actions.deliver.empty() && !dropping_) listener().on_arrivals(actions.deliver, actions.block_ends);
  if (actions.end_sending) (void)listener().on_ended();
  for (const Mismatch& mismatch : actions.mismatches) {
    context_.log->warn("{}: {}", options_.tape.name(), to_text(mismatch));
  }
  if (actions.hang_up) {
    // At the tape's end and where it hangs up, the driver reads what is left first; at a mismatch that fails
    // the run the line breaks where it stands.
    const bool failed = options_.config.on_mismatch == OnMismatch::fail &&
                        (!actions.mismatches.empty() || (actions.run_ended && actions.run_ended->mismatch));
    Error error;
    if (failed && !actions.mismatches.empty()) error.message = to_text(actions.mismatches.front());
    listener().on_down(
        {.reason = LineDown::Reason::hung_up, .error = std::move(error), .after_reading = !failed});
  }
  for (const Mismatch& mismatch : actions.mismatches) reports_->look_for_hint(mismatch);
  const bool exit = actions.exit;
  const std::string trouble = actions.run_ended ? actions.run_ended->trouble.value_or("") : "";
  if (actions.run_ended) take_report(std::move(*actions.run_ended));
  if (exit && any_run_) listener().on_finished(exit_status::kPass);  // the verdict's comes with on_complete
  if (!trouble.empty()) {
    listener().on_down({.reason = LineDown::Reason::lost,
                        .error = make_error(Errc::damaged_tape, trouble),
                        .after_reading = true});
  }
}

void ReplayPort::take_report(RunReport report) {
  any_run_ = true;
  const Instant now = Loop::now();
  report.nobody_came = !run_begun_;
  const Instant begun = std::exchange(run_begun_, std::nullopt).value_or(now);
  report.tape = options_.tape.name();
  report.connection = options_.connection;
  report.when = wall_text(begun, now);
  if (report.nobody_came) report.sessions_made = 0;
  if (options_.session > 0) report.session = options_.session;
  add_stalls(report, begun);
  const bool look = is_look(report);
  reports_->add(std::move(report));
  // The verdict's status comes with on_complete.
  if (options_.once && !look) listener().on_finished(exit_status::kPass);
}

void ReplayPort::add_stalls(RunReport& report, Instant begun) const {
  const std::vector<Stall> stalls = context_.loop->stalls_since(begun);
  for (const Stall& stall : stalls) {
    const auto after = std::chrono::duration<double>(stall.begin - begun).count();
    const auto length = std::chrono::duration<double, std::milli>(stall.length).count();
    report.doubts.push_back(
        {Doubt::Kind::stall,
         fmt::format("this machine or program stood still for {:.0f} ms, {:.3f} s after the "
                     "driver's open: what came late, or too late, may be its doing",
                     length, std::max(after, 0.0))});
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
  return due - context_.loop->last_spin() >= kSpin * kSpinShare;
}

void ReplayPort::set_timer() {
  const std::optional<Instant> due = engine_->next_deadline();
  if (!due) {
    timer_.cancel();
    return;
  }
  if (reading_on_) return timer_.set_after(kPause);
  timer_.set(may_spin(*due) ? *due - kSpin : *due);
}

void ReplayPort::on_timer() {
  if (const std::optional<Instant> due = engine_->next_deadline()) {
    const Instant now = Loop::now();
    if (*due > now && *due - now <= kSpin) {
      if (!may_spin(*due)) return timer_.set(*due);  // another tape has meanwhile
      while (Loop::now() < *due) {
      }
      context_.loop->spun_until(*due);
    }
  }
  pump();
}

void ReplayPort::finish() {
  if (!engine_) return listener().on_complete(0);
  const Instant now = Loop::now();
  // That no driver has come is a verdict too, but of no interest to a program that has the port to itself.
  if (!context_.pulled && !any_run_ && !run_begun_) engine_->on_open(now);
  options_.once = false;  // the session is ending already
  finish_limit_ = now + kFinishLimit;
  finish_timer_.emplace(*context_.loop, [this] {
    engine_->give_up(Loop::now());
    pump();
  });
  finish_timer_->set(now + kReadOnLimit);
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
