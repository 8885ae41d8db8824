#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <functional>
#include <memory>
#include <ostream>
#include <signal.h>
#include <string>
#include <sys/wait.h>
#include <system_error>
#include <utility>
#include <vector>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/loop/signal_watch.hpp"
#include "libport/supervise/lost_rights.hpp"
#include "libport/supervise/probe_calls.hpp"
#include "libport/supervise/supervised_command.hpp"
#include "tools/child_process.hpp"
#include "tools/command_end.hpp"
#include "tools/command_family.hpp"
#include "tools/command_verb.hpp"
#include "tools/option_description.hpp"
#include "tools/tool_log.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

using Effect = ProbeFindings::Effect;
using Stage = SupervisedCommand::Trouble::Stage;

constexpr std::string_view kProbeAbout =
    "Runs COMMAND as it is, on its own device or pty, looks at what it does to ports\n"
    "and how it looks for them, and changes nothing of that. Once it has ended, says\n"
    "on stdout what a plain pty lacks or bends of it, and the line that mends it.\n"
    "A port is any tty but the terminal and what stdin, stdout and stderr are.\n"
    "Setuid programs run as the caller, which is told where COMMAND is one.\n\n"
    "Exit status: COMMAND's own, 128 + N after signal N. Without COMMAND having run:\n"
    "1 system calls cannot be looked at here, 2 wrong use, no such command.\n\n";

double in_seconds(Nanos time) { return static_cast<double>(time.count()) / 1e9; }

bool contains_word(const std::vector<std::string>& words, const std::string& word) {
  return std::ranges::find(words, word) != words.end();
}

// By its own name or by a link to it.
const ProbeFindings::Port* port_of(const ProbeFindings& findings, const std::string& word) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::canonical(word, error);
  const std::string name = error ? word : path.string();
  const auto port = std::ranges::find(findings.ports, name, &ProbeFindings::Port::name);
  return port == findings.ports.end() ? nullptr : &*port;
}

// A port that the command line names can be another: {port} is written there.
void forgive_named(ProbeFindings& findings, const std::vector<std::string>& command) {
  for (ProbeFindings::Row& row : findings.rows) {
    const bool named = std::ranges::any_of(
        command, [&](const std::string& word) { return row.call == ProbeFindings::naming(word); });
    if (!named) continue;
    row.effect = Effect::same;
    row.on_pty = "{port} in COMMAND stands for it";
  }
}

// The command with its port as {port}, under exec. Empty: a plain pty is enough.
std::string remedy_line(const ProbeFindings& findings, std::vector<std::string> command) {
  const bool finds = findings.any(Effect::finds);
  if (!findings.any(Effect::lacks) && !findings.any(Effect::bends) && !finds) return {};
  std::string device;
  bool named = false;
  for (std::string& word : command) {
    const ProbeFindings::Port* const port = port_of(findings, word);
    if (port == nullptr && !contains_word(findings.names, word)) continue;
    if (device.empty() && (port == nullptr || !port->pty)) device = word;
    word = "{port}";
    named = true;
  }
  const auto real = std::ranges::find(findings.ports, false, &ProbeFindings::Port::pty);
  if (device.empty() && real != findings.ports.end()) device = real->name;
  const std::string found_as = !device.empty()           ? device
                               : !findings.names.empty() ? findings.names.front()
                                                         : "/dev/ttyUSB0";
  std::vector<std::string> line{"porttape", "exec", "--device", device.empty() ? "PORT" : device,
                                "--tape",   "NAME"};
  if (finds && (!named || device.empty())) line.insert(line.end(), {"--as", found_as});
  line.emplace_back("--");
  line.insert(line.end(), command.begin(), command.end());
  return shell_line(line);
}

void print_findings(const ProbeFindings& findings, const std::string& remedy, std::ostream& out) {
  for (const ProbeFindings::Port& port : findings.ports)
    fmt::print(out, "port {} ({})\n", printable_line(port.name), port.pty ? "a pty" : "a device");
  if (findings.ports.empty()) fmt::print(out, "no request to a port was seen\n");
  if (!findings.rows.empty())
    fmt::print(out, "  {:<26} {:>7} {:>10}  on a plain pty\n", "call", "times", "first");
  for (const ProbeFindings::Row& row : findings.rows) {
    fmt::print(out, "  {:<26} {:>7} {:>8.3f} s  {:<5}  {}\n", printable_line(row.call), row.count,
               in_seconds(row.first), name_of(row.effect), row.on_pty);
  }
  if (remedy.empty())
    fmt::print(out, "nothing that a pty lacks was asked for: porttape record and test do without exec\n");
  else
    fmt::print(out, "remedy  {}\n", printable_lines(remedy));
}

std::string json_of_findings(const ProbeFindings& findings, const std::string& remedy,
                             const CommandEnd& end) {
  JsonList ports;
  for (const ProbeFindings::Port& port : findings.ports)
    ports.add(JsonObject().add("name", port.name).add_raw("pty", port.pty ? "true" : "false"));
  JsonList calls;
  for (const ProbeFindings::Row& row : findings.rows) {
    calls.add(JsonObject()
                  .add("call", row.call)
                  .add("effect", name_of(row.effect))
                  .add("on_pty", row.on_pty)
                  .add("count", row.count)
                  .add("first_us", row.first.count() / 1000));
  }
  JsonObject object;
  object.add("ports", ports).add("calls", calls);
  if (remedy.empty())
    object.add_raw("remedy", "null");
  else
    object.add("remedy", remedy);
  return object.add("command_exit", end.exit_code()).str();
}

Result<CommandEnd> watch_command(const CommandVerbLine& line, bool to_stderr, ProbeFindings& findings,
                                 CommandFamily& family, std::ostream& err) {
  Loop loop;
  if (Result<void> adopted = family.adopt(); !adopted) return adopted.error();
  std::vector<std::unique_ptr<CallPart>> parts;
  parts.push_back(std::make_unique<ProbeCalls>(findings, loop.clock()));
  CommandEnd end;
  SupervisedCommand::Trouble trouble;
  const SupervisedCommand::Options options{.command = line.command,
                                           .environment = ChildProcess::environment_with({}),
                                           .output_to_stderr = to_stderr,
                                           .traps = Supervisor::traps(parts),
                                           .default_signals = ChildProcess::default_signals()};
  const std::unique_ptr<SupervisedCommand> command = SupervisedCommand::start(
      loop, options,
      [&end](int status) {
        end = WIFSIGNALED(status) ? CommandEnd{.signal = WTERMSIG(status)}
                                  : CommandEnd{.status = WEXITSTATUS(status)};
      },
      trouble);
  if (!command) {
    if (trouble.stage == Stage::exec) return ChildProcess::cannot_run(line.command.front(), trouble.error);
    if (trouble.stage == Stage::trap)
      return make_error(Errc::io, trouble.message + "; the command did not run");
    return make_error(Errc::io, trouble.error == 0
                                    ? trouble.message
                                    : fmt::format("{}: {}", trouble.message, errno_text(trouble.error)));
  }
  if (const std::string lost = lost_rights(line.command.front()); !lost.empty())
    fmt::print(err, "porttape probe: {}\n", printable_line(lost));
  const Supervisor supervisor(loop, command->take_listener(), std::move(parts));
  family.look_through(command->guard());
  SignalWatch signals(loop, [&](int number) {
    if (!signals.from_terminal()) command->kill(number);
  });
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) {
    if (!is_ignored(number)) signals.add({number});
  }
  while (command->running()) loop.run_one();
  family.end(CommandFamily::kTermLimit, CommandFamily::kKillLimit);
  return end;
}

Result<int> probe_command(const CommandVerbLine& line, std::ostream& out, std::ostream& err) {
  const bool json = line.values.contains("json");
  ProbeFindings findings;
  CommandFamily family;
  const Result<CommandEnd> end = watch_command(line, json, findings, family, err);
  if (!end) return end.error();
  forgive_named(findings, line.command);
  const std::string remedy = remedy_line(findings, line.command);
  if (json)
    fmt::print(out, "{}\n", json_of_findings(findings, remedy, *end));
  else
    print_findings(findings, remedy, out);
  return end->exit_code();
}

}  // namespace

int run_probe(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "probe",
                         .usage = "[--json] -- COMMAND…",
                         .about = kProbeAbout,
                         .options = {{.name = "json",
                                      .kind = OptionSpec::Kind::flag,
                                      .help = "one JSON object; the command's stdout goes to stderr"}},
                         .example = "-- ./ups_driver /dev/ttyUSB0",
                         .has_port = false};
  return run_command_verb(verb, args, out, err,
                          [&](const CommandVerbLine& line) { return probe_command(line, out, err); });
}

}  // namespace porttape
