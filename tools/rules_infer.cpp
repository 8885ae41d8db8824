#include <filesystem>
#include <fmt/format.h>
#include <string>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/infer/infer.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_line.hpp"
#include "tools/rules_verbs.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostBytes = std::size_t{64} << 20U;  // of a tape, in one direction
constexpr std::size_t kMostTapes = 16;
constexpr std::size_t kMostChanges = 10'000'000;

constexpr VerbHelp kRulesInferHelp{
    "rules infer", "TAPE TAPE2... -o RULES",
    "Makes a rules file of several tapes of one session: lays what the driver wrote side by\n"
    "side, finds the frames, what in them differs, what counts, what is a checksum and of\n"
    "which bytes, and which frames come more often in one tape than in another. Then it\n"
    "proves the rules: what each tape's driver wrote must pass against each tape, and every\n"
    "change of one byte that they do not let vary must fail (of long tapes a sample, which is\n"
    "told). It gives up where so many rules for so many frames would take minutes. What it found\n"
    "and why goes to stderr. Tapes in which the driver wrote the same need no rules: no file is\n"
    "written then, nor where no rule was found. Exit status: 0 proven, or no rules are needed,\n"
    "3 not proven (a file with rules is written all the same), 2 wrong use, 1 a tape is damaged\n"
    "or nothing can be written.\n",
    "  porttape rules infer monday.log tuesday.log -o laser.rules\n"
    "  porttape test --tape monday.log --rules laser.rules -- ./driver {port}\n"};

Result<SessionTape> read_tape(const std::string& argument) {
  const auto paths = find_tape(argument);
  if (!paths) return paths.error();
  auto reader = TapeReader::open(*paths);
  if (!reader) return reader.error();
  auto session = read_session(*reader, paths->file_name(), kMostBytes);
  if (session && session->writes.empty())
    return make_error(Errc::usage, fmt::format("{} has nothing that a driver wrote; name another tape",
                                               in_quotes(argument)));
  return session;
}

std::optional<std::size_t> parsed_number(const std::string& text) {
  if (text.empty() || text.size() > 8 || text.find_first_not_of("0123456789") != std::string::npos)
    return std::nullopt;
  const auto number = static_cast<std::size_t>(std::stoul(text));
  return number >= 1 && number <= kMostChanges ? std::optional(number) : std::nullopt;
}

// What is wrong with the command line, if anything.
std::string wrong_use(const CommandLine& line) {
  if (line.tapes().size() < 2)
    return fmt::format("one tape shows nothing that differs; type porttape rules infer {} TAPE2 -o RULES",
                       shell_word(line.tapes().front()));
  if (line.tapes().size() > kMostTapes) return fmt::format("more than {} tapes", kMostTapes);
  if (!line.text("output")) return "'output' is missing: RULES; type -o FILE, or -o - for stdout";
  if (line.text("changes") && !parsed_number(*line.text("changes")))
    return fmt::format("'changes': {}; accepted: 1 to {}", in_quotes(*line.text("changes")), kMostChanges);
  return {};
}

Result<void> check_output(const std::string& output, bool overwrite) {
  std::error_code error;
  if (output != "-" && !overwrite && std::filesystem::is_regular_file(output, error))
    return make_error(Errc::usage, fmt::format("{} is there already; name another file, or type --overwrite",
                                               in_quotes(output)));
  return check_report_place(output, "rules file");
}

void tell(const Inference& found, std::span<const SessionTape> sessions, std::ostream& err) {
  const auto lines = [&](std::string_view head, const std::vector<std::string>& texts) {
    for (const std::string& text : texts) {
      err << head << printable_line(text) << '\n';
      head = "            ";
    }
  };
  err << "frames      " << printable_line(found.frames) << '\n';
  lines("found       ", found.reasons);
  lines("left out    ", found.unexplained);
  lines("proof       ", proof_text(found.proof, sessions));
}

int fail(const Error& error, std::ostream& err) {
  err << "porttape rules infer: " << printable_line(error.message) << '\n';
  return exit_status_of(error.code);
}

// As a comment ahead of the rules.
std::string heading(std::span<const SessionTape> sessions, const Inference& found) {
  std::string text = "# Inferred by porttape from";
  for (const SessionTape& session : sessions) text += " " + printable_line(session.name);
  text += found.proven() ? ", and proven by them.\n" : "; NOT PROVEN:\n";
  if (!found.proven())
    for (const std::string& line : proof_text(found.proof, sessions))
      text += "#   " + printable_line(line) + "\n";
  return text;
}

Result<void> write_rules(const std::string& output, const std::string& text, mode_t kept, std::ostream& out) {
  if (output != "-") return write_report(output, text, "rules file", kept);
  out << text;
  return {};
}

// The last line for a person.
std::string ended(std::string_view how, std::string_view what) {
  return fmt::format("{:<12}{}\n", how, printable_line(what));
}

}  // namespace

int run_rules_infer(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kRulesInferHelp);
  line.value("output,o", "RULES", "the file to write; - is stdout");
  line.flag("overwrite", "replace the file where it is there already");
  line.value("changes", "N", "changes of one byte that are tried, over all tapes (20000)");
  if (const auto done = line.parse(args, out, err)) return *done;
  if (const std::string wrong = wrong_use(line); !wrong.empty()) return line.usage_error(err, wrong);
  const std::string output = *line.text("output");
  if (const auto place = check_output(output, line.has("overwrite")); !place) return fail(place.error(), err);
  std::vector<SessionTape> sessions;
  mode_t kept = 0;
  for (const std::string& tape : line.tapes()) {
    if (const auto paths = find_tape(tape)) kept |= kept_from_others(*paths);
    auto session = read_tape(tape);
    if (!session) return fail(session.error(), err);
    sessions.push_back(std::move(*session));
  }
  const std::string_view nothing = output == "-" ? "nothing is written" : "no file is written";
  if (need_no_rules(sessions)) {
    err << ended("no rules", fmt::format("the driver wrote the same in all tapes: {}", nothing));
    return exit_status::kPass;
  }
  ProofLimits limits;
  if (const auto changes = line.text("changes")) limits.changes = *parsed_number(*changes);
  const Inference found = infer_rules(sessions, limits);
  tell(found, sessions, err);
  if (found.rules.rules.empty()) {  // a file that no program accepts
    err << ended("not proven", fmt::format("no rule was found for what differs: {}", nothing));
    return exit_status::kDataMismatch;
  }
  const std::string text = heading(sessions, found) + to_toml(found.rules);
  if (const auto written = write_rules(output, text, kept, out); !written) return fail(written.error(), err);
  err << ended(found.proven() ? "proven" : "not proven", output);
  return found.proven() ? exit_status::kPass : exit_status::kDataMismatch;
}

}  // namespace porttape
