// `porttape recover`: what is sound of a damaged tape.

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <string>

#include "libport/base/printable.hpp"
#include "libport/tape/recover_tape.hpp"
#include "libport/tape/source_mode.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kRecoverHelp{
    "recover", "TAPE -o NAME",
    "Makes a tape of what is sound of a damaged one: every sound block before damage and behind\n"
    "it, every sound line of the events, of the files that are there. Where something is lost a\n"
    "gap event says how much at most, and why; it is told here too. A hole of a file (a part that\n"
    "was never written) is lost, and so is what only looks like blocks where too much does. A tape\n"
    "that has no end gets none. Exit status: 0 nothing is lost, 3 something is (the new tape is\n"
    "there), 1 a file cannot be read or written, 2 wrong use, or nothing looks like a tape.\n",
    "  porttape recover laser.log -o mended\n"
    "  porttape verify laser.log || porttape recover laser.log -o mended\n"};

constexpr int kLossy = 3;

void tell_recovered(const RecoveredTape& tape, const TapePaths& from, bool colors, std::ostream& out) {
  fmt::print(
      out, "{}: {} and {} of {}, {}{}{}\n", printable_line(tape.paths.name()), counted(tape.blocks, "block"),
      counted(tape.events, "event"), printable_line(from.name()),
      color_begin(tape.clean() ? Color::good : Color::doubtful, colors),
      tape.clean() ? std::string("nothing is lost") : counted(tape.loss_count, "place") + " with losses",
      color_end(colors));
  for (const std::string& loss : tape.losses) fmt::print(out, "  lost  {}\n", printable_line(loss));
  if (tape.loss_count > tape.losses.size())
    fmt::print(out, "  lost  … and at {} more; the gap events of {} tell of all\n",
               counted(tape.loss_count - tape.losses.size(), "place"), printable_line(tape.paths.name()));
  for (const std::string& note : tape.notes) fmt::print(out, "  note  {}\n", printable_line(note));
}

}  // namespace

int run_recover(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kRecoverHelp);
  add_new_tape_options(line);
  line.color();
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<NewTapeName> to = read_new_tape(line);
  if (!to) return line.usage_error(err, to.error().message);
  const Result<TapePaths> from = the_tape(line);
  if (!from) return line.usage_error(err, from.error().message);
  if (const auto free = check_new_tape(to->paths, to->writer); !free)
    return fail_verb("recover", free.error(), out, err);
  const ModeOfSources mode(*from);
  Progress progress(err, "recover", size_of_tape(*from));
  const Result<RecoveredTape> tape = recover_tape(
      *from, to->paths, {.writer = to->writer, .progress = [&](std::uint64_t bytes) { progress.at(bytes); }});
  progress.clear();
  if (!tape) return fail_verb("recover", tape.error(), out, err);
  tell_recovered(*tape, *from, line.colors(out), out);
  return tape->clean() ? exit_status::kPass : kLossy;
}

}  // namespace porttape
