#include "tools/verbs.hpp"

#include <algorithm>
#include <array>
#include <iomanip>

#include "libport/base/error.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/version.hpp"

namespace porttape {
namespace {

constexpr std::array kVerbs{
    Verb{"info", "what a tape holds: times, blocks, rates, exchanges, answer latency, events, damage",
         run_info},
    Verb{"cat", "both directions of a tape in order, one line a burst", run_cat},
    Verb{"test", "runs a command against a tape in the device's place, gives the verdict", run_test},
    Verb{"verify", "whether tapes are sound", run_verify},
    Verb{"status", "what the daemons do that run: ports, drivers, bytes, tapes, trouble", run_status},
    Verb{"ctl", "steers a daemon that runs: a mark on its tape, its end", run_ctl},
};

void print_help(std::ostream& out) {
  out << "Usage: porttape VERB [ARGUMENTS]\n"
         "       porttape --help | --version\n\n"
         "Looks at tapes: recordings of what a driver and a device said on a serial line or socket.\n\n"
         "Verbs:\n";
  for (const Verb& verb : kVerbs) out << "  " << std::left << std::setw(8) << verb.name << verb.help << '\n';
  out << "\n`porttape VERB --help` tells more. Example:\n\n  porttape info laser.log\n";
}

}  // namespace

std::span<const Verb> verbs() { return kVerbs; }

int run_porttape(Arguments args, std::ostream& out, std::ostream& err) {
  if (args.empty()) {
    err << "porttape: no verb given; see porttape --help\n";
    return exit_status::kUsage;
  }
  const std::string& name = args.front();
  if (name == "--help" || name == "-h") {
    print_help(out);
    return exit_status::kPass;
  }
  if (name == "--version") {
    out << "porttape " << version() << '\n';
    return exit_status::kPass;
  }
  const auto* verb =
      std::find_if(kVerbs.begin(), kVerbs.end(), [&](const Verb& each) { return each.name == name; });
  if (verb == kVerbs.end()) {
    err << "porttape: unknown " << (name.starts_with('-') ? "option" : "verb") << " '" << printable_line(name)
        << "'; see porttape --help\n";
    return exit_status::kUsage;
  }
  return verb->run(args.subspan(1), out, err);
}

}  // namespace porttape
