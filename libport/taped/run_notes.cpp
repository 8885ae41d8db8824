#include "libport/taped/run_notes.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <string_view>
#include <utility>

namespace porttape {

void RunNotes::open() {
  if (!begun_) unread_.begin_run();
  unread_.begin_session();
}

void RunNotes::begin(Instant now) {
  if (!begun_) begun_ = now;
}

void RunNotes::refused(const line::Refused& refused) {
  ++refused_;
  refused_bytes_ += refused.bytes;
}

void RunNotes::fault(const LineFault& fault) {
  if (fault.kind == LineFault::kPlan) {
    faults_ = {.plan = fault.spec.raw(), .seed = fault.seed.value_or(0)};
  } else if (faults_) {
    faults_->add(fault);
  }
}

void RunNotes::end_run(RunReport& report, const std::vector<Doubt>& of_tape) {
  report.nobody_came = !begun_;
  const Instant begun = std::exchange(begun_, std::nullopt).value_or(loop_.now());
  report.when = wall_text(begun, loop_.clock());
  if (report.nobody_came) report.sessions_made = 0;
  report.faults = faults_;
  if (faults_) faults_ = {.plan = faults_->plan, .seed = faults_->seed};
  if (!report.nobody_came) report.doubts.insert(report.doubts.end(), of_tape.begin(), of_tape.end());
  add_output_flushes(report);
  add_stalls(report, begun);
}

void RunNotes::add_left(RunReport& report) {
  unread_.add_to(report);
  if (auto refused = take_refused()) report.doubts.push_back(std::move(*refused));
}

std::optional<Doubt> RunNotes::take_refused() {
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
void RunNotes::add_output_flushes(RunReport& report) {
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

void RunNotes::add_stalls(RunReport& report, Instant begun) const {
  const std::string_view open =
      report.writer == Writer::driver ? "the driver's open" : roles_of(report.writer).open;
  for (const Stall& stall : loop_.stalls_since(begun)) {
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

}  // namespace porttape
