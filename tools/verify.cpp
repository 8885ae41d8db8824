#include <algorithm>

#include "libport/base/printable.hpp"
#include "libport/tape/judgement.hpp"
#include "tools/command_line.hpp"
#include "tools/output.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kVerifyHelp{
    "verify", "TAPE...",
    "Reads tapes from end to end and says of each whether it is sound: whole, ended, without a\n"
    "gap, and its files those that were recorded (by the digests in its end). A tape of which\n"
    "that is not so is 'no damage found', and notes say why: a gap, no end, a torn tail, still\n"
    "being written. Of one without digests, and of one whose two directions hold the same bytes,\n"
    "they say what could not be checked. A missing, swapped, shortened or foreign file is damage. Exit "
    "status: 0 no damage, 1 one is damaged\n"
    "or cannot be read, 2 one is not a tape or not there.\n",
    "  porttape verify laser.log\n"
    "  porttape verify *.logr || echo do not use these\n"};

int verify_tape(const std::string& argument, bool colors, std::ostream& out, std::ostream& err) {
  const auto paths = find_tape(argument);
  const auto summary = paths ? summarize(*paths) : Result<TapeSummary>(paths.error());
  if (!summary) {
    const Error& error = summary.error();
    if (error.code == Errc::not_a_tape) {
      out << printable_line(paths->name()) << ": not a tape: " << printable_line(error.message) << '\n';
    } else if (error.code == Errc::damaged_tape) {
      out << printable_line(paths->name()) << ": damaged: " << printable_line(error.message)
          << "; porttape recover TAPE -o NAME keeps what is sound of it\n";
    } else {
      out.flush();
      err << "porttape verify: " << printable_line(error.message) << '\n';
    }
    return exit_status_of(error.code);
  }
  const std::string name = printable_line(summary->name);
  const Judgement judgement = judge(*summary);
  for (const std::string& damage : judgement.damages)
    out << name << ": " << color_begin(Color::bad, colors) << "damaged" << color_end(colors) << ": "
        << printable_line(damage) << '\n';
  if (judgement.damages.empty()) {
    out << name << ": " << color_begin(color_of(judgement.verdict), colors) << words_of(judgement.verdict)
        << color_end(colors) << ": " << summary->read.blocks << " read and " << summary->write.blocks
        << " write blocks, " << seconds_number(summary->duration().count()) << " s\n";
  }
  for (const std::string& note : judgement.notes) out << name << ": note: " << printable_line(note) << '\n';
  return judgement.damages.empty() ? exit_status::kPass : exit_status::kRuntime;
}

}  // namespace

int run_verify(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kVerifyHelp);
  line.color();
  if (const auto done = line.parse(args, out, err)) return *done;
  int worst = exit_status::kPass;
  for (const std::string& tape : line.tapes())
    worst = std::max(worst, verify_tape(tape, line.colors(out), out, err));
  return worst;
}

}  // namespace porttape
