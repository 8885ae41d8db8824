#include "libport/replay/faults_report.hpp"

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr std::size_t kPlanShown = 200;  // characters, in a line of text

}  // namespace

void FaultsReport::add(const LineFault& fault) {
  const std::uint64_t count = fault.kind == LineFault::kMore ? fault.count : 1;
  made += count;
  kinds[fault.kind] += count;
  if (list.size() < kMostListed && fault.kind != LineFault::kMore) list.push_back(fault);
}

std::string to_text(const FaultsReport& faults) {
  std::string kinds;
  for (const auto& [kind, count] : faults.kinds)
    kinds += (kinds.empty() ? "" : ", ") + std::to_string(count) + ' ' + kind.for_line();
  const std::string plan = printable_line(faults.plan.substr(0, kPlanShown));
  return (faults.made == 0 ? "none made" : std::to_string(faults.made) + " made (" + kinds + ')') + " by " +
         plan + (faults.plan.size() > kPlanShown ? "…" : "") + "; seed " + std::to_string(faults.seed);
}

std::string to_json(const FaultsReport& faults) {
  JsonObject kinds;
  for (const auto& [kind, count] : faults.kinds) kinds.add(kind.raw(), count);
  JsonList list;
  for (const LineFault& fault : faults.list) {
    JsonObject one;
    one.add("kind", fault.kind);
    if (fault.dir) one.add("dir", to_string(*fault.dir));
    if (fault.offset) one.add("offset", *fault.offset);
    list.add(one.add("spec", fault.spec));
  }
  return JsonObject()
      .add("plan", faults.plan)
      .add("seed", faults.seed)
      .add("made", faults.made)
      .add("kinds", kinds)
      .add("list", list)
      .str();
}

}  // namespace porttape
