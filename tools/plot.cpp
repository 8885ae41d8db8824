#include <fmt/format.h>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/tape_plot.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kPlotHelp{
    "plot", "TAPE -o PICTURE.svg",
    "Draws a tape: the traffic of both directions over its time with its events (opens, closes, marks,\n"
    "losses, gaps), bytes a second, and how long the device took to answer. The picture is SVG, for\n"
    "browsers and documents. Exit status: 0, 1 the tape is damaged (what is sound is drawn, and the\n"
    "picture says so) or something cannot be read or written, 2 wrong use, no such tape.\n",
    "  porttape plot laser.log -o laser.svg\n"
    "  porttape plot laser.log -o - | display\n"};

// What is wrong with the tape, if anything.
std::optional<Error> draw(TapeReader& tape, TapePlot& plot, std::vector<std::string>& notes) {
  for (;;) {
    const auto record = tape.next();
    if (!record) {
      notes.push_back(record.error().message + "; what is sound is drawn");
      return record.error();
    }
    if (!*record) break;
    plot.add(**record);
  }
  if (const auto torn = tape.torn_tail()) notes.push_back(*torn);
  return std::nullopt;
}

}  // namespace

int run_plot(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kPlotHelp);
  line.value("output,o", "FILE", "the picture; - is stdout")
      .flag("overwrite", "replaces a file that is there");
  if (const auto done = line.parse(args, out, err)) return *done;
  const auto fail = [&](const Error& error) { return fail_verb("plot", error, out, err); };
  if (line.tapes().size() > 1) return line.usage_error(err, "more than one tape given");
  const auto output = line.text("output");
  if (!output || output->empty()) return line.usage_error(err, "-o FILE is missing: where the picture goes");
  const auto paths = find_tape(line.tapes().front());
  if (!paths) return fail(paths.error());
  if (const auto apart = check_report_apart(*output, *paths); !apart) return fail(apart.error());
  Result<NewFile> file = NewFile::create(*output, line.has("overwrite"));
  if (!file) return fail(file.error());
  if (const Result<void> made = file->made_of(*paths); !made) return fail(made.error());
  auto tape = TapeReader::open(*paths, {.events_may_fail = true});
  if (!tape) return fail(tape.error());
  TapePlot plot;
  std::vector<std::string> notes;
  const std::optional<Error> damage = draw(*tape, plot, notes);
  const std::string picture = plot.svg(paths->file_name(), notes);
  if (Result<void> added = file->add(picture); !added) return fail(added.error());
  if (Result<void> finished = file->finish(); !finished) return fail(finished.error());
  if (!damage) return exit_status::kPass;
  fail(*damage);
  return exit_status::kRuntime;
}

}  // namespace porttape
