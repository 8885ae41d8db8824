// `porttape view`: one or two tapes as a page to look around in.

#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/verbs.hpp"
#include "tools/view_writer.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kViewHelp{
    "view", "TAPE [TAPE2] -o PAGE.html",
    "Makes a page of a tape, to look around in with a browser: what is worth a look, a timeline\n"
    "of both directions, exchanges and how long they took, every block in hex and text, search,\n"
    "events. With a second tape both side by side, and their differences as porttape diff tells\n"
    "them. One file that needs nothing else and loads nothing; press ? in it for its keys. Exit\n"
    "status: 0, 1 a tape is damaged (what is sound is shown, and the page says so) or something\n"
    "cannot be read or written, 2 wrong use, no such tape, over 256 MiB of tapes.\n",
    "  porttape view laser.log -o laser.html\n"
    "  porttape view good.log bad.log -o both.html --overwrite\n"};

struct ViewPlan {
  std::vector<TapePaths> tapes;
  std::string output;
  std::uint64_t bytes = 0;
};

Result<ViewPlan> read_view_plan(const CommandLine& line) {
  ViewPlan plan;
  if (line.tapes().size() > 2) return usage_error("more than two tapes given");
  plan.output = line.text("output").value_or("");
  if (plan.output.empty()) return usage_error("-o FILE is missing: where the page goes");
  for (const std::string& name : line.tapes()) {
    Result<TapePaths> tape = find_tape(name);
    if (!tape) return tape.error();
    if (const auto apart = check_report_apart(plan.output, *tape); !apart) return apart.error();
    plan.bytes += size_of_tape(*tape);
    plan.tapes.push_back(std::move(*tape));
  }
  if (plan.bytes > kMostViewBytes)
    return usage_error(fmt::format(
        "{} MiB are more than a page can hold, which are {}; cut out what matters, as by porttape "
        "cut {} --from 0 --to 60 -o part",
        plan.bytes >> 20U, kMostViewBytes >> 20U, shell_word(line.tapes().front())));
  return plan;
}

// What is wrong with the tapes.
Result<std::vector<Error>> write_view(const ViewPlan& plan, bool overwrite, Progress& progress) {
  Result<NewFile> file = NewFile::create(plan.output, overwrite);
  if (!file) return file.error();
  for (const TapePaths& tape : plan.tapes) {
    if (Result<void> made = file->made_of(tape); !made) return made.error();
  }
  ViewWriter page(*file, [&](std::uint64_t bytes) { progress.at(bytes); });
  if (Result<void> begun = page.begin(); !begun) return begun.error();
  for (const TapePaths& tape : plan.tapes) {
    if (Result<void> added = page.add_tape(tape); !added) return added.error();
  }
  if (plan.tapes.size() == 2 && page.damage().empty()) {
    const TapeDiffOptions options;
    const Result<TapeDiff> diff = diff_tapes(plan.tapes[0], plan.tapes[1], options);
    if (!diff) return diff.error();
    const auto compared = page.add_differences(plan.tapes[0], plan.tapes[1], *diff, options.margin);
    if (!compared) return compared.error();
  }
  if (Result<void> ended = page.end(); !ended) return ended.error();
  if (Result<void> finished = file->finish(); !finished) return finished.error();
  return page.damage();
}

}  // namespace

int run_view(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kViewHelp);
  line.value("output,o", "FILE", "the page; - is stdout").flag("overwrite", "replaces a file that is there");
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<ViewPlan> plan = read_view_plan(line);
  if (!plan) return line.usage_error(err, plan.error().message);
  Progress progress(err, "view", plan->bytes);
  const Result<std::vector<Error>> damage = write_view(*plan, line.has("overwrite"), progress);
  progress.clear();
  if (!damage) return fail_verb("view", damage.error(), out, err);
  int status = exit_status::kPass;
  for (const Error& error : *damage) status = fail_verb("view", error, out, err);
  return status;
}

}  // namespace porttape
