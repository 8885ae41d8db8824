// `porttape pack`: tapes and what they were recorded with as one file.

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <fstream>
#include <iostream>
#include <string>
#include <sys/utsname.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/pack/make_pack.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

using Facts = std::vector<std::pair<std::string, StrangerText>>;

constexpr VerbHelp kPackHelp{
    "pack", "TAPE... -o FILE",
    "Makes one compressed file of tapes, for a bug report: their files byte for byte, and a\n"
    "manifest with digests and what you tell of the driver. A tar, which tar opens too;\n"
    "`porttape unpack` checks it. Facts about this machine (kernel, system, processor) go in when\n"
    "you have seen them and say yes on the terminal, or by --facts. What is secret on a tape stays\n"
    "on it: see `porttape redact`. A tape with a hole (a part that was never written) is not\n"
    "packed: see `porttape recover`. Exit status: 0, 1 a file cannot be read or written, 2 wrong\n"
    "use.\n",
    "  porttape pack clean -o bug.tar.zst\n"
    "  porttape pack clean -o bug.tar.zst --redaction report.json \\\n"
    "    --driver-version 'laserd 2.1' --command 'laserd -p /dev/ttyUSB0'\n"};

// PRETTY_NAME of os-release.
std::string system_name() {
  std::ifstream file("/etc/os-release");
  for (std::string line; std::getline(file, line);) {
    constexpr std::string_view key = "PRETTY_NAME=";
    if (!line.starts_with(key)) continue;
    std::string name = line.substr(key.size());
    if (name.size() >= 2 && name.front() == '"' && name.back() == '"') name = name.substr(1, name.size() - 2);
    return name;
  }
  return {};
}

Facts facts_of_system() {
  Facts facts;
  utsname names{};
  if (::uname(&names) == 0) {
    facts.emplace_back("kernel", fmt::format("{} {} {}", names.sysname, names.release, names.version));
    facts.emplace_back("machine", names.machine);
  }
  if (std::string name = system_name(); !name.empty()) facts.emplace_back("system", std::move(name));
  facts.emplace_back("processors", std::to_string(::sysconf(_SC_NPROCESSORS_ONLN)));
  return facts;
}

bool can_ask(const std::ostream& err) {
  return &err == &std::cerr && ::isatty(STDIN_FILENO) == 1 && ::isatty(STDERR_FILENO) == 1;
}

// What goes into the pack: nothing that the user has not seen or asked for.
Facts agreed_facts(const CommandLine& line, std::ostream& err) {
  if (line.has("no-facts")) return {};
  if (line.has("facts")) return facts_of_system();
  if (!can_ask(err)) return {};
  Facts facts = facts_of_system();
  err << "Facts about this machine help with a bug report:\n";
  for (const auto& [key, value] : facts) err << "  " << key << ": " << value.for_line() << '\n';
  err << "Put them into the pack? [y/N] " << std::flush;
  std::string answer;
  std::getline(std::cin, answer);
  return answer == "y" || answer == "Y" || answer == "yes" ? facts : Facts();
}

void tell_packed(const PackManifest& pack, const std::string& file, std::ostream& out) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  const std::string packed = file == "-" || error ? "" : fmt::format(" in {} bytes", size);
  fmt::print(out, "{}: {} and {}{} of {} bytes\n", printable_line(file), counted(pack.tapes.size(), "tape"),
             counted(pack.files.size() + 1, "file"), packed, pack.bytes());
  for (const PackedTape& tape : pack.tapes)
    fmt::print(out, "  tape {}: {}\n", printable_line(tape.name), tape.verdict.for_line());
  for (const auto& [key, value] : pack.system) fmt::print(out, "  {}: {}\n", key, value.for_line());
  if (pack.redaction) return;
  out << "  note  no report of a redaction is in it; `porttape redact` takes secrets off a tape\n";
}

}  // namespace

int run_pack(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kPackHelp);
  line.value("output,o", "FILE", "the pack: zstd, or gzip where it ends in .gz or .tgz; - is stdout")
      .flag("overwrite", "it replaces a file of that name")
      .value("driver-version", "TEXT", "which driver, of which version")
      .value("command", "TEXT", "the driver's command line")
      .value("redaction", "FILE", "the report of porttape redact --report FILE")
      .flag("facts", "with facts about this machine, unasked")
      .flag("no-facts", "without them, and unasked");
  if (const auto done = line.parse(args, out, err)) return *done;
  const auto file = line.text("output");
  if (!file || file->empty())
    return line.usage_error(err, "option 'output' is missing: -o FILE, the pack that is to be made");
  if (line.has("facts") && line.has("no-facts"))
    return line.usage_error(err, "options 'facts' and 'no-facts' do not go together; choose one");
  std::vector<TapePaths> tapes;
  std::uint64_t bytes = 0;
  for (const std::string& name : line.tapes()) {
    Result<TapePaths> tape = find_tape(name);
    if (!tape) return line.usage_error(err, tape.error().message);
    bytes += size_of_tape(*tape);
    tapes.push_back(std::move(*tape));
  }
  PackOptions options;
  options.overwrite = line.has("overwrite");
  options.about.driver_version = line.text("driver-version").value_or("");
  options.about.driver_command = line.text("command").value_or("");
  if (const auto redaction = line.text("redaction")) options.redaction = *redaction;
  if (options.redaction == "-")
    return line.usage_error(err, "option 'redaction': - is no file; name the report's file");
  options.about.system = agreed_facts(line, err);
  Progress progress(err, "pack", 2 * bytes);
  options.progress = [&](std::uint64_t done) { progress.at(done); };
  const Result<PackManifest> pack = make_pack(tapes, *file, options);
  progress.clear();
  if (!pack) return fail_verb("pack", pack.error(), out, err);
  tell_packed(*pack, *file, *file == "-" ? err : out);
  return exit_status::kPass;
}

}  // namespace porttape
