// `porttape diff`: what two tapes have of each other, and what not.

#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_line.hpp"
#include "tools/diff_printer.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kDiffHelp{
    "diff", "A B [--html FILE] [--margin S] [--json]",
    "Compares two tapes exchange by exchange, however the bytes were cut into blocks: what B has\n"
    "more (added) or less (missing), what is changed and from which byte on, what is elsewhere\n"
    "(moved), and what takes longer or shorter by more than the margin (slower, faster). Long\n"
    "runs of one direction are compared in parts. Events count, but for their times. Exit status:\n"
    "0 the same, 3 different, 1 a tape is damaged or cannot be read, 2 wrong use, no such tape.\n",
    "  porttape diff good.log bad.log\n"
    "  porttape diff good.log bad.log --margin 0.5 --html difference.html\n"
    "  porttape diff good.log bad.log --margin off --no-events --json | jq .kind\n"};

constexpr std::uint64_t kDifferencesShown = 20;
constexpr std::uint64_t kDifferencesOnPage = 1000;

struct DiffPlan {
  TapePaths one;
  TapePaths other;
  TapeDiffOptions options;
  std::string html;
};

Result<void> check_page(const CommandLine& line, const DiffPlan& plan) {
  if (plan.html.empty()) return make_error(Errc::usage, "option 'html': the file's name is empty");
  for (const TapePaths* tape : {&plan.one, &plan.other}) {
    if (const auto apart = check_report_apart(plan.html, *tape); !apart) return apart;
  }
  if (const auto place = check_report_place(plan.html, "page"); !place) return place;
  if (plan.html == "-" && line.has("json"))
    return make_error(Errc::usage, "both the page and JSON would go to stdout; name a file for the page");
  // Tried now, made when the tapes have been read.
  const Result<NewFile> free = NewFile::create(plan.html, line.has("overwrite"));
  return free ? Result<void>() : Result<void>(free.error());
}

Result<DiffPlan> read_diff_plan(const CommandLine& line) {
  if (line.tapes().size() != 2)
    return make_error(Errc::usage, fmt::format("two tapes are compared, {} given", line.tapes().size()));
  DiffPlan plan;
  if (const auto margin = line.text("margin")) {
    const auto seconds = parse_seconds(*margin);
    if (!seconds && *margin != "off")
      return make_error(Errc::usage,
                        fmt::format("option 'margin': {} is no time; it is in seconds, e.g. 0.1, "
                                    "or off",
                                    in_quotes(*margin)));
    plan.options.margin.reset();
    if (seconds) plan.options.margin = *seconds - TapeTime{};
  }
  plan.options.events = !line.has("no-events");
  Result<TapePaths> one = find_tape(line.tapes()[0]);
  if (!one) return one.error();
  Result<TapePaths> other = find_tape(line.tapes()[1]);
  if (!other) return other.error();
  plan.one = std::move(*one);
  plan.other = std::move(*other);
  if (const auto html = line.text("html")) {
    plan.html = *html;
    if (const auto page = check_page(line, plan); !page) return page.error();
  }
  return plan;
}

// Shows it to each printer, as many differences as that one wants.
struct DiffAudience {
  DiffPrinter* printer = nullptr;
  std::uint64_t most = 0;
};

Result<void> show_diff(const DiffPlan& plan, const TapeDiff& diff,
                       const std::vector<DiffAudience>& audience) {
  const DiffTitle title{plan.one.file_name(), plan.other.file_name(), plan.options.margin};
  std::uint64_t most = 0;
  for (const DiffAudience& each : audience) {
    if (const auto begun = each.printer->begin(title, diff); !begun) return begun;
    most = std::max(most, each.most);
  }
  const std::uint64_t all = diff.differences.size();
  auto reader =
      DifferenceReader::open(plan.one, plan.other, diff.differences, {.events = diff.events, .most = most});
  if (!reader) return reader.error();
  for (std::uint64_t number = 0; number < std::min(all, most); ++number) {
    const Result<ShownDifference> next = reader->next();
    if (!next) return next.error();
    for (const DiffAudience& each : audience) {
      if (number >= each.most) continue;
      if (const auto shown = each.printer->difference(*next); !shown) return shown;
    }
  }
  for (const DiffAudience& each : audience) {
    if (const auto ended = each.printer->end(all - std::min(all, each.most)); !ended) return ended;
  }
  return {};
}

Result<void> show_diff(const DiffPlan& plan, const TapeDiff& diff, const CommandLine& line,
                       std::ostream& out) {
  constexpr auto no_limit = std::numeric_limits<std::uint64_t>::max();
  const bool all = line.has("all");
  TextDiffPrinter text(out, line.colors(out), columns_of(out).value_or(80));
  JsonDiffPrinter json(out);
  std::vector<DiffAudience> audience;
  if (line.has("json")) {
    audience.push_back({&json, no_limit});
  } else if (plan.html != "-") {
    audience.push_back({&text, all ? no_limit : kDifferencesShown});
  }
  if (plan.html.empty()) return show_diff(plan, diff, audience);
  Result<NewFile> file = NewFile::create(plan.html, line.has("overwrite"));
  if (!file) return file.error();
  for (const TapePaths* const tape : {&plan.one, &plan.other}) {
    if (Result<void> made = file->made_of(*tape); !made) return made;
  }
  HtmlDiffPrinter page(*file);
  audience.push_back({&page, all ? no_limit : kDifferencesOnPage});
  if (Result<void> shown = show_diff(plan, diff, audience); !shown) return shown;
  return file->finish();
}

void note_torn_tails(const TapeDiff& diff, std::ostream& out, std::ostream& err) {
  for (const ComparedTape* tape : {&diff.one, &diff.other}) {
    if (!tape->torn_tail) continue;
    out.flush();
    err << "porttape diff: note: " << printable_line(*tape->torn_tail) << '\n';
  }
}

}  // namespace

int run_diff(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kDiffHelp);
  line.value("margin", "S", "seconds by which a time may differ, 0.1 without it; or off")
      .flag("no-events", "events are not compared")
      .flag("all", "every difference: else 20, and 1000 on a page")
      .flag("json", "JSON Lines, every difference (tools/OUTPUT.md)")
      .value("html", "FILE", "makes a page of it too; - is stdout")
      .flag("overwrite", "the page replaces a file that is there")
      .color();
  if (const auto done = line.parse(args, out, err)) return *done;
  Result<DiffPlan> plan = read_diff_plan(line);
  if (!plan) return line.usage_error(err, plan.error().message);
  Progress progress(err, "diff", size_of_tape(plan->one) + size_of_tape(plan->other));
  plan->options.progress = [&](std::uint64_t bytes) { progress.at(bytes); };
  const Result<TapeDiff> diff = diff_tapes(plan->one, plan->other, plan->options);
  progress.clear();
  if (!diff) return fail_verb("diff", diff.error(), out, err);
  if (const auto shown = show_diff(*plan, *diff, line, out); !shown)
    return fail_verb("diff", shown.error(), out, err);
  note_torn_tails(*diff, out, err);
  // What was not written cannot be told by "different" alone.
  out.flush();
  if (const int written = output_status(out, exit_status::kPass);
      diff->equal() || written != exit_status::kPass)
    return written;
  return exit_status::kDataMismatch;
}

}  // namespace porttape
