#include <algorithm>

#include "libport/base/printable.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tools/command_line.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kHelp{
    "verify", "TAPE...",
    "Reads tapes from end to end and says of each whether it is sound. A torn tail (the\n"
    "recorder was killed inside a block) is a note. Exit status: 0 all are sound, 1 one is\n"
    "damaged or cannot be read, 2 one is not a tape or not there.\n",
    "  porttape verify laser.log\n"
    "  porttape verify *.logr || echo do not use these\n"};

int verify_tape(const std::string& argument, std::ostream& out, std::ostream& err) {
  const auto paths = find_tape(argument);
  const auto summary = paths ? summarize(*paths) : Result<TapeSummary>(paths.error());
  if (!summary) {
    const Error& error = summary.error();
    if (error.code == Errc::not_a_tape) {
      out << printable_line(paths->name()) << ": not a tape: " << printable_line(error.message) << '\n';
    } else {
      out.flush();
      err << "porttape verify: " << printable_line(error.message) << '\n';
    }
    return exit_status_of(error.code);
  }
  const auto damages = summary->damages();
  for (const Error& damage : damages)
    out << printable_line(summary->name + ": damaged: " + damage.message) << '\n';
  if (damages.empty()) {
    out << printable_line(summary->name) << ": sound: " << summary->read.blocks << " read and "
        << summary->write.blocks << " write blocks, " << seconds_text(summary->duration().count()) << " s\n";
  }
  for (const std::string& note : summary->torn_tails())
    out << printable_line(summary->name + ": note: " + note) << '\n';
  return damages.empty() ? exit_status::kPass : exit_status::kRuntime;
}

}  // namespace

int run_verify(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kHelp);
  if (const auto done = line.parse(args, out, err)) return *done;
  int worst = exit_status::kPass;
  for (const std::string& tape : line.tapes()) worst = std::max(worst, verify_tape(tape, out, err));
  return worst;
}

}  // namespace porttape
