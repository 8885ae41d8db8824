#pragma once

#include <ostream>
#include <span>
#include <string>
#include <string_view>

// The verbs of the program `porttape`. Each takes the arguments behind its name, writes data to `out` and
// everything else to `err`, and gives the exit status. A failing `out` is not theirs to report: main() does.
namespace porttape {

using Arguments = std::span<const std::string>;

int run_bless(Arguments args, std::ostream& out, std::ostream& err);
int run_cat(Arguments args, std::ostream& out, std::ostream& err);
int run_convert(Arguments args, std::ostream& out, std::ostream& err);
int run_cut(Arguments args, std::ostream& out, std::ostream& err);
int run_ctl(Arguments args, std::ostream& out, std::ostream& err);
int run_stats(Arguments args, std::ostream& out, std::ostream& err);
int run_diff(Arguments args, std::ostream& out, std::ostream& err);
int run_drive(Arguments args, std::ostream& out, std::ostream& err);
int run_exec(Arguments args, std::ostream& out, std::ostream& err);
int run_merge(Arguments args, std::ostream& out, std::ostream& err);
int run_plot(Arguments args, std::ostream& out, std::ostream& err);
int run_pack(Arguments args, std::ostream& out, std::ostream& err);
int run_probe(Arguments args, std::ostream& out, std::ostream& err);
int run_info(Arguments args, std::ostream& out, std::ostream& err);
int run_record(Arguments args, std::ostream& out, std::ostream& err);
int run_recover(Arguments args, std::ostream& out, std::ostream& err);
int run_redact(Arguments args, std::ostream& out, std::ostream& err);
int run_rules(Arguments args, std::ostream& out, std::ostream& err);
int run_shrink(Arguments args, std::ostream& out, std::ostream& err);
int run_soak(Arguments args, std::ostream& out, std::ostream& err);
int run_split(Arguments args, std::ostream& out, std::ostream& err);
int run_status(Arguments args, std::ostream& out, std::ostream& err);
int run_test(Arguments args, std::ostream& out, std::ostream& err);
int run_unpack(Arguments args, std::ostream& out, std::ostream& err);
int run_verify(Arguments args, std::ostream& out, std::ostream& err);
int run_view(Arguments args, std::ostream& out, std::ostream& err);

struct Verb {
  std::string_view name;
  std::string_view help;  // one line
  int (*run)(Arguments args, std::ostream& out, std::ostream& err);
};
std::span<const Verb> verbs();

// The whole program: the arguments behind its name.
int run_porttape(Arguments args, std::ostream& out, std::ostream& err);

}  // namespace porttape
