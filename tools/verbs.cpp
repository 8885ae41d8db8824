#include "tools/verbs.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "libport/base/error.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/version.hpp"
#include "libport/catalog/port_types.hpp"
#include "libport/port/help_table.hpp"
#include "tools/verb_advice.hpp"

namespace porttape {
namespace {

constexpr std::array kVerbs{
    Verb{"info", "what a tape holds: times, blocks, rates, exchanges, answer latency, events, damage",
         run_info},
    Verb{"cat", "both directions of a tape in order, one line a burst", run_cat},
    Verb{"record", "runs a command on a device, keeps a tape of what they say", run_record},
    Verb{"test", "runs a command against a tape in the device's place, gives the verdict", run_test},
    Verb{"drive", "plays a tape's driver to a device and checks what it answers, gives the verdict",
         run_drive},
    Verb{"bless", "makes the tape of a driver that was changed on purpose, shows the difference", run_bless},
    Verb{"exec", "runs a command with what a pty lacks: modem lines, parity, breaks, drains", run_exec},
    Verb{"probe", "what a command does to its port that a pty lacks or bends, and the remedy", run_probe},
    Verb{"soak", "looks for the seed whose faults break a command against a tape", run_soak},
    Verb{"shrink", "the fewest exchanges and faults of a tape under which a command still fails", run_shrink},
    Verb{"verify", "whether tapes are sound", run_verify},
    Verb{"recover", "what is sound of a damaged tape, as a tape; what is lost is told", run_recover},
    Verb{"cut", "a part of a tape as a tape of its own: by times, exchanges or marks", run_cut},
    Verb{"split", "the parts of a tape as tapes: sessions, marks, times, silences", run_split},
    Verb{"merge", "several tapes as one, in the order of time", run_merge},
    Verb{"convert", "evidence of other forms as a tape, a tape in other forms; editable text", run_convert},
    Verb{"plot", "a tape as a picture: traffic, events, throughput, how long answers took", run_plot},
    Verb{"stats", "how a conversation went: answer times, rates, silences, each command", run_stats},
    Verb{"view", "one or two tapes as a page: timeline, exchanges, search, comparison", run_view},
    Verb{"diff", "what two tapes differ in: exchanges added, missing, changed, moved, slower", run_diff},
    Verb{"redact", "a tape without its secrets: fillers in their place, checksums mended", run_redact},
    Verb{"pack", "tapes and what they were recorded with as one file, for a bug report", run_pack},
    Verb{"unpack", "what was packed, checked, in a new folder", run_unpack},
    Verb{"rules", "what of a driver's writes may vary: rules files against tapes", run_rules},
    Verb{"status", "what the daemons do that run: ports, drivers, bytes, tapes, trouble", run_status},
    Verb{"ctl", "steers a daemon that runs: a mark on its tape, its end", run_ctl},
};

static_assert(same_names(kVerbs, kToolVerbs), "a verb is missing in verb_advice.hpp");

void print_verbs(std::ostream& out) {
  out << "Usage: porttape VERB [ARGUMENTS]\n"
         "       porttape --help | --help-ports | --version\n\n"
         "Looks at tapes: recordings of what a driver and a device said on a serial line\n"
         "or socket.\n\nVerbs:\n";
  std::vector<HelpRow> rows;
  for (const Verb& verb : kVerbs) rows.push_back({std::string(verb.name), std::string(verb.help)});
  out << help_table(rows);
  out << "\n`porttape VERB --help` tells more. Example:\n\n  porttape info laser.log\n";
}

int fail(const std::string& message, std::ostream& err) {
  err << "porttape: " << printable_line(message) << '\n';
  return exit_status::kUsage;
}

}  // namespace

std::span<const Verb> verbs() { return kVerbs; }

int run_porttape(Arguments args, std::ostream& out, std::ostream& err) {
  if (args.empty()) return fail(no_verb("porttape", args), err);
  if (args.front() == "help" && args.size() > 1) {
    const std::array<std::string, 2> asked{args[1], "--help"};
    return run_porttape(asked, out, err);
  }
  const std::string& name = args.front();
  if (name == "--help" || name == "-h" || name == "help") {
    print_verbs(out);
    return exit_status::kPass;
  }
  if (name == "--help-ports") {
    out << port_help(port_types());
    return exit_status::kPass;
  }
  if (name == "--version") {
    out << "porttape " << version() << '\n';
    return exit_status::kPass;
  }
  const auto* verb =
      std::find_if(kVerbs.begin(), kVerbs.end(), [&](const Verb& each) { return each.name == name; });
  if (verb == kVerbs.end()) return fail(no_verb("porttape", args), err);
  return verb->run(args.subspan(1), out, err);
}

}  // namespace porttape
