#include "libport/replay/run_doubts.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <string>

#include "libport/replay/roles.hpp"
#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostGapsTold = 8;

std::string text_of(const TapeGap& gap, const Roles& roles) {
  const std::string what = gap.bytes > 0 ? std::to_string(gap.bytes) + " bytes are" : "something is";
  return what + " missing on the tape from " + seconds_text(to_us(gap.from)) + " to " +
         seconds_text(to_us(gap.to)) + (gap.why.empty() ? "" : " (" + gap.why.for_line() + ")") + ": what " +
         std::string(roles.one) + ' ' + std::string(roles.wrote) + " there was not compared";
}

}  // namespace

void add_gaps(RunReport& report, const std::vector<TapeGap>& gaps, std::size_t reached) {
  for (std::size_t i = 0; i < std::min(reached, gaps.size()); ++i) {
    if (i == kMostGapsTold) {
      report.doubts.push_back({Doubt::Kind::gap, "and " + std::to_string(reached - i) + " more gaps"});
      return;
    }
    report.doubts.push_back({Doubt::Kind::gap, text_of(gaps[i], roles_of(report.writer))});
  }
}

void add_doubtful_answers(RunReport& report, std::uint64_t answers) {
  if (answers == 0) return;
  const std::string what =
      answers == 1 ? "what the tape has" : fmt::format("{} times what the tape has", answers);
  report.doubts.push_back(
      {Doubt::Kind::answer,
       fmt::format(
           "{} behind a frame that {} left out came all the same; whether it answers that frame, with_answer "
           "in the rule says",
           what, roles_of(report.writer).one)});
}

}  // namespace porttape
