#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/error.hpp"
#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/port/help_table.hpp"
#include "tools/rules_verbs.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr std::array kRulesVerbs{
    Verb{"check", "what the rules of a file are about on a tape, and what none is about", run_rules_check},
    Verb{"infer", "makes a rules file of several tapes of one session, and proves it", run_rules_infer},
};

void print_rules_verbs(std::ostream& out) {
  out << "Usage: porttape rules VERB [ARGUMENTS]\n\n"
         "Works on rules files: what of a driver's writes may vary when a tape is replayed\n"
         "(--rules FILE), and how the answers follow.\n\nVerbs:\n";
  std::vector<HelpRow> rows;
  for (const Verb& verb : kRulesVerbs) rows.push_back({std::string(verb.name), std::string(verb.help)});
  out << help_table(rows);
  out << "\n`porttape rules VERB --help` tells more. Example:\n\n  porttape rules check laser.log "
         "laser.rules\n";
}

std::string no_rules_verb(Arguments args) {
  std::vector<std::string_view> names;
  std::string accepted;
  for (const Verb& verb : kRulesVerbs) {
    names.push_back(verb.name);
    accepted += (accepted.empty() ? "" : ", ") + std::string(verb.name);
  }
  if (args.empty()) return "rules: a verb is missing; accepted: " + accepted + "; see porttape rules --help";
  return "rules: " + in_quotes(args.front()) + " is no verb; accepted: " + accepted +
         did_you_mean(args.front(), names);
}

}  // namespace

int run_rules(Arguments args, std::ostream& out, std::ostream& err) {
  const std::string first = args.empty() ? "" : args.front();
  if (first == "--help" || first == "-h") {
    print_rules_verbs(out);
    return exit_status::kPass;
  }
  const auto* verb = std::find_if(kRulesVerbs.begin(), kRulesVerbs.end(),
                                  [&](const Verb& each) { return each.name == first; });
  if (verb != kRulesVerbs.end()) return verb->run(args.subspan(1), out, err);
  err << "porttape: " << printable_line(no_rules_verb(args)) << '\n';
  return exit_status::kUsage;
}

}  // namespace porttape
