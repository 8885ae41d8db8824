#include "tests/simulation/replay_report_check.hpp"

#include <algorithm>
#include <initializer_list>
#include <string_view>

namespace porttape::simulation {
namespace {

using Kind = TapeItem::Kind;
using Wrong = Mistake::Kind;

int exit_status_of(std::string_view verdict) {
  if (verdict == "pass") return 0;
  if (verdict == "timing-mismatch") return 4;
  return verdict == "incomplete" ? 5 : 3;
}

class Check {
 public:
  Check(World& world, const std::string& name, const ReplayPlan& plan, const ReportFile& report,
        const ReplayEnd& end)
      : world_(&world),
        name_(&name),
        plan_(&plan),
        report_(&report),
        end_(&end),
        verdict_(report.verdict()) {}

  void options() const {
    const int due = exit_status_of(verdict_);
    const std::int64_t exit = report_->number("exit").value_or(-1);
    if (exit != due) wrong(fmt::format("verdict {} with exit status {}", verdict_, exit));
    if (due != 0 && !end_->failed) wrong("the daemon ended with 0, and the verdict is " + verdict_);
    if (report_->number("strictness") != plan_->strictness() || report_->word("timing") != plan_->timing())
      wrong("the report has other options: " + report_->text());
    const bool has_mismatch = report_->at("mismatch").is_object();
    // What outranks a mismatch of time need not have one of its own.
    const bool outranks =
        verdict_ == "settings-mismatch" || (verdict_ == "incomplete" && plan_->is_punctual());
    if (has_mismatch != (verdict_ != "pass" && verdict_ != "incomplete") && !outranks &&
        plan_->strictness() > 0)
      wrong(fmt::format("verdict {} and its mismatch: {}", verdict_, report_->text()));
  }

  // Of a driver that did as recorded.
  void verdict() const {
    const bool done = came_through() && !plan_->pauses_decide() &&
                      end_->item == plan_->script().items().size() &&
                      end_->bytes_out == plan_->script().reads().size();
    // A line that ends before the driver has made its last settings, or before the replay has seen them,
    // leaves these out.
    const bool missed = end_->missed_settings && verdict_ == "settings-mismatch";
    const bool too_late =
        end_->half_close_may_be_missed && plan_->script().has(Kind::driver_ends) && verdict_ == "incomplete";
    // By the recorded clock the tape, and with it the line, may end before anything of the driver has come,
    // which is a look and no run.
    const bool looked = verdict_ == "incomplete" && report_->number("from_driver.bytes") == 0 &&
                        !plan_->is_gated() && !plan_->goes_on_at_end();
    if (done && verdict_ != "pass" && !missed && !too_late && !looked)
      wrong("the driver did as recorded: " + report_->text());
    const bool all_written = end_->written == plan_->script().writes().size();
    if (verdict_ == "pass" && !all_written && !plan_->looks_up() && plan_->strictness() > 0 &&
        !plan_->script().has(Kind::hang_up))
      wrong(fmt::format("the verdict is pass, and the driver wrote {} of {} bytes", end_->written,
                        plan_->script().writes().size()));
  }

  // Of a driver that made its mistake.
  void mistake() const {
    const Mistake& mistake = plan_->mistake();
    if (!end_->made_mistake || !came_through()) return;
    const std::string what = fmt::format("the driver did {}", name_of(mistake.kind));
    const bool settings = mistake.kind == Wrong::settings;
    if (settings && end_->item < plan_->script().items().size()) return;
    const bool allowed = plan_->strictness() == 0 || (mistake.kind == Wrong::time && plan_->strictness() < 2);
    const bool silent = end_->written == 0;  // a look
    if ((allowed || (settings && !plan_->checks_settings())) && !silent && verdict_ != "pass" &&
        verdict_ != "settings-mismatch")
      wrong(fmt::format("{}, which is no matter: {}", what, report_->text()));
    if (settings || allowed) return;
    if (!is_allowed(mistake.kind)) wrong(fmt::format("{}, and the verdict is {}", what, verdict_));
    if (mistake.kind == Wrong::byte && verdict_ == "data-mismatch" && !tells_place(mistake))
      wrong(fmt::format("byte {} was wrong, the report tells: {}", mistake.offset, report_->text()));
  }

  void counts() const {
    if (end_->lost_bytes) return;
    count("to_driver.bytes", end_->bytes_out);
    count("to_driver.of", plan_->script().reads().size());
    count("from_driver.of", plan_->script().writes().size());
    // What comes behind a run's end is not counted. At strictness 0 a gated tape ends by patience, too, which
    // may be over when a disk has held the loop up.
    const bool ends_by_driver = plan_->is_gated() && plan_->strictness() > 0;
    if (end_->finished && plan_->as_recorded() && (plan_->goes_on_at_end() || ends_by_driver))
      count("from_driver.bytes", end_->bytes_in);
    const auto matched = report_->number("from_driver.matched");
    if (matched && *matched > static_cast<std::int64_t>(end_->bytes_in))
      wrong(fmt::format("{} bytes matched, of {} written", *matched, end_->bytes_in));
    const bool all_written = !plan_->looks_up() || end_->bytes_in == plan_->script().writes().size();
    if (verdict_ == "pass" && plan_->strictness() > 0 && !plan_->script().has(Kind::hang_up) && all_written)
      count("from_driver.matched", plan_->script().writes().size());
    const std::int64_t steps = report_->number("playback.steps").value_or(0);
    if (steps > static_cast<std::int64_t>(end_->steps))
      wrong(fmt::format("the report tells of {} steps, {} were asked for", steps, end_->steps));
  }

 private:
  void wrong(const std::string& what) const { world_->wrong("{}: {}", *name_, what); }

  // The replay was told of all that the driver wrote. What came after an end that was wanted at once reached
  // nobody.
  [[nodiscard]] bool came_through() const {
    return end_->finished && end_->bytes_in == end_->written && !end_->lost_bytes;
  }

  [[nodiscard]] bool is_one_of(std::initializer_list<std::string_view> verdicts) const {
    return std::ranges::find(verdicts, verdict_) != verdicts.end();
  }

  [[nodiscard]] bool is_allowed(Wrong kind) const {
    // By lookup requests may come in any order, or never.
    if (plan_->looks_up() && verdict_ == "pass" && (kind == Wrong::early || plan_->mistake_is_asked()))
      return true;
    switch (kind) {
      case Wrong::none:
      case Wrong::settings:
        return true;
      case Wrong::byte:
        // By lookup it may begin another request.
        return is_one_of({"data-mismatch"}) || (plan_->looks_up() && verdict_ == "incomplete");
      case Wrong::missing:
        // What is written next may begin with what is missing, and then completes it too late.
        return is_one_of({"data-mismatch", "incomplete"}) ||
               (plan_->is_punctual() && verdict_ == "timing-mismatch");
      case Wrong::extra:
        return is_one_of({"data-mismatch", "extra"});
      case Wrong::trailing:
        // By lookup it begins a request, or none.
        return plan_->looks_up() ? is_one_of({"data-mismatch", "incomplete"}) : is_one_of({"extra"});
      case Wrong::time:
        return is_one_of({end_->item < plan_->script().items().size() ? "incomplete" : "timing-mismatch",
                          "timing-mismatch"});
      case Wrong::early:
        break;
    }
    return is_one_of({"incomplete"});
  }

  // By lookup the place hangs on the requests that the bytes before may be.
  [[nodiscard]] bool tells_place(const Mistake& mistake) const {
    const std::int64_t told = report_->number("mismatch.offset").value_or(-1);
    const auto right = static_cast<std::int64_t>(mistake.offset);
    return plan_->looks_up() || told == right;
  }

  void count(std::string_view path, std::uint64_t right) const {
    const auto told = report_->number(path);
    if (told && *told != static_cast<std::int64_t>(right))
      wrong(fmt::format("{} is {}, and {} is right", path, *told, right));
  }

  World* world_;
  const std::string* name_;
  const ReplayPlan* plan_;
  const ReportFile* report_;
  const ReplayEnd* end_;
  std::string verdict_;
};

}  // namespace

void check_report(World& world, const std::string& name, const ReplayPlan& plan, const ReportFile& report,
                  const ReplayEnd& end) {
  const Check check(world, name, plan, report, end);
  check.options();
  plan.as_recorded() ? check.verdict() : check.mistake();
  check.counts();
}

}  // namespace porttape::simulation
