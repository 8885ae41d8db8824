#include <chrono>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <map>
#include <ostream>
#include <string>
#include <unistd.h>
#include <utility>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/faults/fault_plan.hpp"
#include "libport/replay/tape_count.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tools/command_end.hpp"
#include "tools/fault_case.hpp"
#include "tools/fault_pool.hpp"
#include "tools/output.hpp"
#include "tools/verb_clock.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr int kFound = 3;
constexpr std::uint64_t kMostSeeds = 1'000'000'000;

constexpr std::string_view kSoakAbout =
    "Runs COMMAND against a tape again and again, each time with the faults of\n"
    "another seed on its line, until one breaks it: COMMAND is ended by a signal,\n"
    "hangs, or ends with another status than 0, which it does not do without faults.\n"
    "Each run has a port of its own. Prints the line that repeats it.\n\n"
    "Without --faults there are about four faults a run, in what the driver is sent:\n"
    "bytes that are lost, changed, doubled or late. Nothing is waited for\n"
    "(--timing none), and a request that comes again is answered again (--match\n"
    "lookup): a driver that repeats what went wrong comes through.\n\n"
    "Exit status: 0 no seed breaks it, 3 one does, 1 it does so without faults too,\n"
    "or a run failed, 2 wrong use; 130 and 143 when interrupted.\n\n";

struct Seeds {
  std::uint64_t from = 1;
  std::uint64_t to = 100;
};

const OptionSpec kSeeds{.name = "seeds",
                        .default_value = "1..100",
                        .help = "the seeds to be tried, one after the other",
                        .value_name = "A..B"};

Result<Seeds> read_seeds(const std::string& text) {
  const std::size_t dots = text.find("..");
  const auto from = whole_number<std::uint64_t>(text.substr(0, dots));
  const auto to = dots == std::string::npos ? from : whole_number<std::uint64_t>(text.substr(dots + 2));
  if (from && to && *from <= *to && *to - *from < kMostSeeds && *to < (std::uint64_t{1} << 53U))
    return Seeds{*from, *to};
  return make_error(Errc::usage,
                    fmt::format("option 'seeds': {} is not valid; accepted: A..B, whole numbers, at most {} "
                                "of them, as in 1..1000",
                                in_quotes(text), kMostSeeds));
}

// About four a run: each byte that the driver is sent has the same part in them.
Result<std::string> default_mix(const TapePaths& tape) {
  Result<TapeReader> reader = TapeReader::open(tape);
  if (!reader) return reader.error();
  const std::optional<TapeTotals> totals = count_tape(*reader);
  if (!totals)
    return make_error(Errc::damaged_tape, tape.name() + ": it cannot be read; porttape verify tells why");
  if (totals->reads == 0)
    return make_error(
        Errc::usage,
        fmt::format("{} has nothing that a driver is sent; name the faults with --faults", tape.name()));
  const auto p = [&totals](double a_run) {
    return fmt::format("{:.2g}", std::min(0.5, a_run / static_cast<double>(totals->reads)));
  };
  const std::string text = fmt::format(
      "drop:p={0}:dir=r;corrupt:p={0}:dir=r;duplicate:p={1}:dir=r;drop:p={1}:dir=r:burst=8;delay:p={1}:dir=r:"
      "for=0.05;"
      "stall:p={2}:dir=r:for=0.3",
      p(1), p(0.5), p(0.25));
  const Result<FaultPlan> plan = parse_fault_plan(text, LineDir::r);
  return plan ? Result<std::string>(plan->text()) : plan.error();
}

class Soak {
 public:
  Soak(FaultCase the_case, Seeds seeds, FaultPool pool, std::ostream& out, std::ostream& err)
      : case_(std::move(the_case)),
        seeds_(seeds),
        pool_(std::move(pool)),
        out_(out),
        err_(err),
        shows_progress_(::isatty(STDERR_FILENO) == 1) {}

  Result<int> run() {
    const Result<FaultPool::Done> without = pool_.run({.tape = case_.tape.name()});
    if (pool_.interrupted_by() != 0) return interrupted();
    if (!without) return without.error();
    if (const auto failure = failure_of(without->end, case_.fails_by)) {
      fmt::print(err_, "{}", last_lines(without->output));
      return make_error(Errc::io, fmt::format("without any fault, too, {}; try {}", failure->text,
                                              test_line(case_, case_.tape.name(), {}, 0)));
    }
    if (without->end.bytes == 0) {
      return make_error(Errc::io,
                        "without any fault, too, nothing passes on the command's line, which no seed can "
                        "break; it is to open {port}, which stands in COMMAND for the path, or "
                        "$PORTTAPE_PORT of its environment, and to write what is on the tape");
    }
    if (Result<void> searched = search(); !searched) return searched.error();
    clear_progress();
    if (pool_.interrupted_by() != 0) return interrupted();
    if (found_.empty()) return tell_none();
    return tell(found_.begin()->first, found_.begin()->second);
  }

 private:
  // Up to the lowest seed that breaks it: those that were begun before are waited for.
  Result<void> search() {
    std::uint64_t next = seeds_.from;
    for (;;) {
      while (found_.empty() && next <= seeds_.to && pool_.waiting() + pool_.running() < case_.jobs * 2)
        begin(next++);
      if (!found_.empty() && !runs_below(found_.begin()->first)) break;
      const std::optional<FaultPool::Done> done = pool_.wait(verb_clock().now() + FaultPool::kProgress);
      if (pool_.interrupted_by() != 0) return {};
      if (done && !done->trouble.empty()) return make_error(Errc::io, done->trouble);
      if (done) take(*done);
      if (!done && seed_of_.empty()) break;
      show_progress();
    }
    pool_.cancel();
    return {};
  }

  void begin(std::uint64_t seed) {
    seed_of_[pool_.add({.tape = case_.tape.name(), .faults = case_.faults, .seed = seed})] = seed;
  }

  [[nodiscard]] bool runs_below(std::uint64_t seed) const {
    for (const auto& [job, other] : seed_of_) {
      if (other < seed) return true;
    }
    return false;
  }

  void take(FaultPool::Done done) {
    const auto job = seed_of_.extract(done.job);
    if (!job) return;
    ++done_;
    faults_ += done.end.faults_made;
    if (failure_of(done.end, case_.fails_by)) found_.emplace(job.mapped(), std::move(done));
  }

  void show_progress() {
    const Instant at = verb_clock().now();
    if (!shows_progress_ || at - shown_ < FaultPool::kProgress) return;
    shown_ = at;
    fmt::print(err_, "\rporttape soak: {} of {} seeds, {} faults, none breaks it ", done_, total(), faults_);
    err_ << std::flush;
    shown_any_ = true;
  }
  void clear_progress() {
    if (std::exchange(shown_any_, false)) err_ << "\r\033[K" << std::flush;
  }
  [[nodiscard]] std::uint64_t total() const { return seeds_.to - seeds_.from + 1; }

  int interrupted() {
    clear_progress();
    fmt::print(err_, "porttape soak: interrupted by {} after {} of {} seeds, none of which breaks it\n",
               signal_text(pool_.interrupted_by()), done_, total());
    return 128 + pool_.interrupted_by();
  }

  int tell_none() {
    if (case_.as_json) {
      out_ << json("none").add_raw("seed", "null").str() << '\n';
    } else {
      fmt::print(out_, "no seed of {}..{} breaks it: {} runs, {} faults\n  faults    {}\n", seeds_.from,
                 seeds_.to, done_, faults_, case_.faults);
    }
    return output_status(out_, exit_status::kPass);
  }

  int tell(std::uint64_t seed, const FaultPool::Done& done) {
    const FaultFailure failure = *failure_of(done.end, case_.fails_by);
    const std::string repeat = test_line(case_, case_.tape.name(), case_.faults, seed);
    const std::string shrink = shrink_line(case_, case_.faults, seed);
    if (case_.as_json) {
      JsonList made;
      for (const std::string& fault : done.end.faults) made.add(fault);
      out_ << json("found")
                  .add("seed", seed)
                  .add("failure", failure.text)
                  .add("made", made)
                  .add("output", done.output)
                  .add("repeat", repeat)
                  .add("shrink", shrink)
                  .str()
           << '\n';
      return output_status(out_, kFound);
    }
    fmt::print(out_, "seed {} breaks it: {} (runs: {})\n", seed, printable_line(failure.text), done_);
    const std::string lines = last_lines(done.output);
    if (!lines.empty()) fmt::print(out_, "  its last words\n{}", lines);
    fmt::print(out_, "  faults    {} made: {}\n", done.end.faults_made, first_of(done.end.faults));
    fmt::print(out_, "  repeat    {}\n  shrink    {}\n", repeat, shrink);
    return output_status(out_, kFound);
  }

  static std::string first_of(const std::vector<std::string>& faults) {
    std::string text;
    for (std::size_t n = 0; n < std::min<std::size_t>(faults.size(), 8); ++n)
      text += (text.empty() ? "" : "; ") + faults[n];
    return faults.size() > 8 ? text + "; …" : text;
  }

  [[nodiscard]] JsonObject json(std::string_view result) const {
    JsonObject object;
    object.add("result", result)
        .add("tape", case_.tape.name())
        .add("seeds", JsonObject().add("from", seeds_.from).add("to", seeds_.to).add("run", done_))
        .add("faults", case_.faults)
        .add("faults_made", faults_);
    return object;
  }

  FaultCase case_;
  Seeds seeds_;
  FaultPool pool_;
  std::ostream& out_;
  std::ostream& err_;
  std::map<std::size_t, std::uint64_t> seed_of_;    // of the jobs that run
  std::map<std::uint64_t, FaultPool::Done> found_;  // by seed
  std::uint64_t done_ = 0;
  std::uint64_t faults_ = 0;
  Instant shown_{};
  bool shows_progress_;
  bool shown_any_ = false;
};

Result<int> soak(CommandVerbLine line, std::ostream& out, std::ostream& err) {
  const auto written = line.values.extract("seeds");
  const Result<Seeds> seeds = written ? read_seeds(written.mapped()) : Result<Seeds>(Seeds{});
  if (!seeds) return seeds.error();
  Result<FaultCase> the_case = read_fault_case(line);
  if (!the_case) return the_case.error();
  if (the_case->faults.empty()) {
    Result<std::string> mix = default_mix(the_case->tape);
    if (!mix) return mix.error();
    the_case->faults = std::move(*mix);
  }
  Result<FaultPool> pool = FaultPool::make(*the_case);
  if (!pool) return pool.error();
  return Soak(std::move(*the_case), *seeds, std::move(*pool), out, err).run();
}

std::vector<OptionSpec> soak_options() {
  std::vector<OptionSpec> specs = fault_case_options();
  std::erase_if(specs, [](const OptionSpec& spec) { return spec.name == "seed"; });
  specs.push_back(kSeeds);
  return specs;
}

}  // namespace

int run_soak(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "soak",
                         .usage = "--tape NAME [--seeds A..B] [-j N] [options] -- COMMAND…",
                         .about = kSoakAbout,
                         .options = soak_options(),
                         .example = "--tape laser --seeds 1..1000 -- ./laser_driver --device {port}"};
  return run_command_verb(verb, args, out, err,
                          [&](CommandVerbLine line) { return soak(std::move(line), out, err); });
}

}  // namespace porttape
