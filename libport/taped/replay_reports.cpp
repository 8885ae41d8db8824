#include "libport/taped/replay_reports.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <iterator>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/printable.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/excerpt.hpp"
#include "libport/replay/hint.hpp"
#include "libport/replay/tape_count.hpp"
#include "libport/replay/test_case.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/tape_facts.hpp"

namespace porttape {
namespace {

// The worst run as the one test that a replay is; there is one.
std::string junit_of(const RunList& runs) {
  const RunReport& worst = runs.worst().value();
  const TestCase test = test_case_of(worst, worst.tape, "porttape");
  return to_junit("porttape replay", {&test, 1}, test.seconds);
}

}  // namespace

// Work on another thread. It and the loop share this and nothing else; `stop` asks it to end early.
struct ReplayReports::Job {
  std::atomic<bool> stop{false};
  bool done = false;  // written by the loop's thread, and so are the results
};

struct ReplayReports::Count : Job {
  std::optional<TapeTotals> totals;
};

struct ReplayReports::Checking : Job {
  std::optional<TapeCheck> found;  // nothing: it was not read to its end
};

struct ReplayReports::Search : Job {
  Mismatch mismatch;
  std::optional<std::string> hint;
};

// The tape around what is wrong, and what follows from it.
struct ReplayReports::Diagnosing : Job {
  RunReport report;
};

ReplayReports::ReplayReports(const PortContext& context, Options options, Publish publish)
    : context_(context),
      options_(std::move(options)),
      publish_(std::move(publish)),
      timer_(*context.loop, [this] { move_on(); }) {
  kept_ = kept_from_others(options_.tape);
  if (!options_.group) return;
  file_strand_ = options_.group->file_strand;  // so that the newest comes last
  options_.group->kept |= kept_;
}

ReplayReports::~ReplayReports() {
  if (count_) count_->stop = true;
  if (check_) check_->stop = true;
  for (const auto& search : searches_) search->stop = true;
  for (const Waiting& waiting : waiting_) {
    if (waiting.search) waiting.search->stop = true;
    if (waiting.diagnosing) waiting.diagnosing->stop = true;
  }
}

// False where no thread is to be had.
bool ReplayReports::run(const Workers::Strand& strand, const std::shared_ptr<Job>& job,
                        std::function<void()> work, std::function<void()> done) {
  return context_.loop->run_elsewhere(strand, std::move(work),
                                      [job, done = std::move(done), alive = std::weak_ptr<int>(alive_)] {
                                        job->done = true;
                                        if (!alive.expired()) done();
                                      });
}

void ReplayReports::begin_check() {
  if (!options_.unchecked || check_) return;
  check_ = std::make_shared<Checking>();
  const auto found = std::make_shared<std::optional<TapeCheck>>();
  const auto work = [check = check_, found, tape = options_.tape] {
    *found = check_tape(tape, [&check] { return check->stop.load(); });
  };
  const bool begun = run(check_strand_, check_, work, [this, found] {
    check_->found = std::move(*found);
    move_on();
  });
  check_->done = !begun;
}

void ReplayReports::begin_count() {
  begin_check();
  if (options_.totals || count_) return;
  count_ = std::make_shared<Count>();
  const auto found = std::make_shared<std::optional<TapeTotals>>();
  const auto work = [count = count_, found, tape = options_.tape, as = options_.as, start = options_.start] {
    const auto played = PlayedTape::open(tape, as);
    if (played)
      *found = count_tape(
          **played, [&count] { return count->stop.load(); }, start);
  };
  const bool begun = run(count_strand_, count_, work, [this, found] {
    count_->totals = *found;
    options_.totals = *found;
    move_on();
  });
  count_->done = !begun;
}

void ReplayReports::look_for_hint(const Mismatch& mismatch) {
  if (mismatch.kind == MismatchKind::timing || searches_.size() >= kMostHints) return;
  auto search = std::make_shared<Search>();
  search->mismatch = mismatch;
  const auto found = std::make_shared<std::optional<std::string>>();
  const auto work = [search, found, tape = options_.tape, as = options_.as] {
    const auto played = PlayedTape::open(tape, as, PlayedTape::Select::compared);
    if (!played) return;
    *found = find_hint(**played, search->mismatch.tape_offset, search->mismatch.got,
                       [&search] { return search->stop.load(); });
  };
  const bool begun = run(hint_strand_, search, work, [this, search, found] {
    search->hint = *found;
    hint_found(*search);
  });
  if (begun) searches_.push_back(std::move(search));
}

void ReplayReports::hint_found(const Search& search) {
  const Roles roles = roles_of(options_.as.writer);
  if (search.hint && !search.hint->empty()) {
    context_.log->warn("{}: what {} {} at byte {} is {}", options_.tape.name(), roles.one, roles.wrote,
                       search.mismatch.offset, *search.hint);
  }
  move_on();
}

void ReplayReports::add(RunReport report) {
  begin_count();
  Waiting waiting{.report = std::move(report), .ended = context_.loop->now()};
  const auto first = std::ranges::find_if(searches_, [&waiting](const auto& search) {
    return waiting.report.mismatch && search->mismatch.kind == waiting.report.mismatch->kind &&
           search->mismatch.offset == waiting.report.mismatch->offset;
  });
  for (auto search = searches_.begin(); search != searches_.end(); ++search) {
    if (search != first) (*search)->stop = true;
  }
  if (first != searches_.end()) waiting.search = *first;
  searches_.clear();
  waiting_.push_back(std::move(waiting));
  move_on();
}

// Publishes what is complete.
void ReplayReports::move_on() {
  const Instant now = context_.loop->now();
  while (!waiting_.empty() && complete(waiting_.front(), now)) {
    RunReport report = std::move(waiting_.front().report);
    waiting_.pop_front();
    publish(std::move(report));
  }
  set_timer();
  if (!done_ || !waiting_.empty() || (file_under_way_ && now < *limit_)) return;
  if (file_under_way_) {
    context_.log->error("report {} was not written in time: what it goes to takes nothing",
                        in_quotes(options_.file.empty() ? options_.junit_file : options_.file));
    file_failed_ = true;
  }
  timer_.cancel();
  std::exchange(done_, nullptr)(!file_failed_);
}

void ReplayReports::publish(RunReport report) {
  if (options_.group)
    std::ranges::move(std::exchange(options_.group->doubts, {}), std::back_inserter(report.doubts));
  runs_.add(report);
  if (options_.group) options_.group->runs.add(report);
  if (!options_.file.empty() || !options_.junit_file.empty()) write_file();
  publish_(report);
}

void ReplayReports::add_late_doubts() {
  RunReport report = options_.group->runs.latest().value();
  report.again = true;
  publish(std::move(report));
}

void ReplayReports::add_late_doubt(Doubt doubt) {
  if (!waiting_.empty()) return waiting_.back().report.doubts.push_back(std::move(doubt));
  if (!runs_.latest()) return;
  RunReport report = *runs_.latest();
  report.again = true;
  report.doubts.push_back(std::move(doubt));
  publish(std::move(report));
}

bool ReplayReports::complete(Waiting& waiting, Instant now) {
  const bool hint = has_hint(waiting, now);
  if (!waiting.settled && !settle(waiting, now)) return false;
  return has_diagnosis(waiting, now) && hint;
}

// By the count and the check, or without what of them does not come in time, the report has its verdict.
bool ReplayReports::settle(Waiting& waiting, Instant now) {
  const bool counted = options_.totals || count_->done;
  const bool checked = !check_ || check_->done;
  if (!(counted && checked) && !late(waiting.ended + kCountLimit, now)) return false;
  if (options_.totals) {
    add_totals(waiting.report, *options_.totals);
  } else {
    count_->stop = true;
    give_up_totals(waiting.report, "it was not counted in time, so that writes may be missing");
  }
  judge_reading(waiting.report);
  if (check_) add_check(waiting.report);
  begin_diagnosis(waiting, now);
  return true;
}

// A verdict is about all of the tape.
void ReplayReports::add_check(RunReport& report) const {
  if (!check_->found) {
    report.doubts.push_back(
        {Doubt::Kind::unchecked,
         "the tape was not read to its end in time: whether it is as it was recorded is not "
         "known; `porttape verify` tells"});
  } else if (const Result<void>& sound = check_->found->found; !sound && !report.trouble) {
    damage(report, sound.error().message);
  }
}

void ReplayReports::begin_diagnosis(Waiting& waiting, Instant now) {
  waiting.settled = now;
  const std::optional<std::uint64_t> place = place_of_fault(waiting.report);
  if (!place) return diagnose(waiting.report);
  auto job = std::make_shared<Diagnosing>();
  const auto diagnosed = std::make_shared<RunReport>(waiting.report);
  const auto work = [job, diagnosed, place, tape = options_.tape, as = options_.as] {
    const auto played = PlayedTape::open(tape, as);
    if (!played) return;
    auto found = read_excerpt(**played, *place, kFrameGap, [&job] { return job->stop.load(); });
    const PlaybackReport& playback = diagnosed->playback;
    if (found && !playback.preroll) begin_at(*found, playback.start);
    if (found) diagnosed->excerpt = std::make_shared<const TapeExcerpt>(*std::move(found));
    diagnose(*diagnosed);
  };
  const bool begun = run(diagnosis_strand_, job, work, [this, job, diagnosed] {
    job->report = std::move(*diagnosed);
    move_on();
  });
  if (begun) waiting.diagnosing = std::move(job);
}

bool ReplayReports::has_diagnosis(Waiting& waiting, Instant now) {
  if (!waiting.diagnosing) return true;
  if (waiting.diagnosing->done) {
    waiting.report.excerpt = waiting.diagnosing->report.excerpt;
    waiting.report.diagnosis = std::move(waiting.diagnosing->report.diagnosis);
  } else if (!late(*waiting.settled + kHintLimit, now)) {
    return false;
  }
  waiting.diagnosing->stop = true;
  waiting.diagnosing.reset();
  return true;
}

bool ReplayReports::has_hint(Waiting& waiting, Instant now) {
  if (!waiting.search) return true;
  if (!waiting.search->done && !late(waiting.ended + kHintLimit, now)) return false;
  waiting.search->stop = true;
  waiting.report.mismatch->hint =
      waiting.search->hint.value_or("not known: looking for the bytes elsewhere on the tape was given up");
  waiting.search.reset();
  return true;
}

bool ReplayReports::late(Instant limit, Instant now) const {
  return now >= limit || (limit_ && now >= *limit_ - kFileTime);
}

void ReplayReports::write_file() {
  file_outdated_ = file_under_way_;
  if (file_under_way_) return;
  const RunList& runs = options_.group ? options_.group->runs : runs_;
  const auto job = std::make_shared<Job>();
  const auto written = std::make_shared<Result<void>>();
  const auto work = [written, file = options_.file, text = to_json(runs), junit_file = options_.junit_file,
                     junit = junit_of(runs), kept = options_.group ? options_.group->kept : kept_] {
    if (!file.empty()) *written = write_report(file, text, "report", kept);
    if (junit_file.empty()) return;
    if (const Result<void> other = write_report(junit_file, junit, "report", kept); *written)
      *written = other;
  };
  file_under_way_ = true;
  const bool begun = run(file_strand_, job, work, [this, written] {
    file_written(*written);
    move_on();
  });
  if (begun) return;
  work();
  file_written(*written);
}

void ReplayReports::file_written(const Result<void>& written) {
  file_under_way_ = false;
  if (!written) context_.log->error("{}", written.error().message);
  file_failed_ = file_failed_ || !written;
  if (file_outdated_) write_file();
}

void ReplayReports::finish(Instant limit, std::function<void(bool)> done) {
  limit_ = limit;
  done_ = std::move(done);
  move_on();
}

void ReplayReports::set_timer() {
  std::optional<Instant> next;
  const auto at = [&next](Instant when) { next = next ? std::min(*next, when) : when; };
  if (done_) at(waiting_.empty() ? *limit_ : *limit_ - kFileTime);
  if (!waiting_.empty()) {
    const Waiting& first = waiting_.front();
    if (!first.settled) at(first.ended + kCountLimit);
    if (first.search) at(first.ended + kHintLimit);
    if (first.diagnosing) at(*first.settled + kHintLimit);
  }
  next ? timer_.set(*next) : timer_.cancel();
}

}  // namespace porttape
