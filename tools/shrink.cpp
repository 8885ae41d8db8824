#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <map>
#include <numeric>
#include <ostream>
#include <string>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tools/command_end.hpp"
#include "tools/fault_case.hpp"
#include "tools/fault_pool.hpp"
#include "tools/output.hpp"
#include "tools/private_folder.hpp"
#include "tools/shrinker.hpp"
#include "tools/tape_parts.hpp"
#include "tools/verb_clock.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr std::string_view kShrinkAbout =
    "Makes a failing run smaller: takes a tape, the faults under which COMMAND fails\n"
    "(porttape soak finds them) and leaves out exchanges and faults, as long as it\n"
    "fails in the same way. What is left is written as a new tape, with the line that\n"
    "repeats the failure. Exchanges are left out whole: a run of writes and what is\n"
    "read up to the next one.\n\n"
    "Exit status: 0 done, also where nothing could be left out, 1 a run failed, or\n"
    "the command does not fail, 2 wrong use; 130 and 143 when interrupted, with what\n"
    "was found by then.\n\n";

const OptionSpec kOutput{
    .name = "output", .help = "the new tape; one that is there is never replaced", .value_name = "NAME"};

// The first word of the last line, which is the same for the same failure, as an exception's name is.
std::string head_of_last_line(const std::string& output) {
  const std::size_t end = output.find_last_not_of(" \t\r\n");
  if (end == std::string::npos) return {};
  const std::size_t begin = output.rfind('\n', end);
  const std::string line = output.substr(begin == std::string::npos ? 0 : begin + 1, end - begin);
  return line.substr(0, line.find_first_of(": 0123456789"));
}

// How a run failed, for comparison.
struct Failed {
  std::string kind;
  std::string words;
  std::string unknown_hex;  // what the driver asked that was not on the tape
};

class Shrink {
 public:
  Shrink(FaultCase the_case, TapePaths output, TapeParts tape, FaultPool pool, std::ostream& out,
         std::ostream& err)
      : case_(std::move(the_case)),
        output_(std::move(output)),
        tape_(std::move(tape)),
        pool_(std::move(pool)),
        out_(out),
        err_(err),
        shows_progress_(::isatty(STDERR_FILENO) == 1) {}

  Result<int> run() {
    Result<std::string> folder = folder_.make();
    if (!folder) return folder.error();
    path_ = *folder;
    Result<ShrinkCase> failing = reproduce();
    if (pool_.interrupted_by() != 0) return interrupted();
    if (!failing) return failing.error();
    const ShrinkCase given = *failing;
    Shrinker shrinker(
        std::move(*failing), [this](std::vector<ShrinkCase>& cases) { return try_all(cases); },
        [this] { return pool_.interrupted_by() != 0 || trouble_.has_value(); });
    const ShrinkCase& best = shrinker.run();
    clear_progress();
    if (trouble_) return *trouble_;
    const ModeOfSources mode(case_.tape);
    if (Result<void> written = tape_.write(output_, best.parts, true); !written) return written.error();
    const int status = tell(given, best);
    return pool_.interrupted_by() == 0 ? status : interrupted();
  }

 private:
  // A run under way: of the case at `index`, or of its tape without faults.
  struct Run {
    std::size_t index = 0;
    bool without_faults = false;
  };
  // The cases of one try_all().
  struct Round {
    std::vector<ShrinkCase>& cases;
    std::vector<std::string> tapes = {};
    std::vector<bool> over = {};  // does not fail so
    std::map<std::size_t, Run> runs = {};
    std::optional<std::size_t> found = {};

    // Whether all before it are over.
    [[nodiscard]] bool is_first(std::size_t index) const {
      return std::all_of(over.begin(), over.begin() + static_cast<std::ptrdiff_t>(index),
                         [](bool each) { return each; });
    }
  };

  // The case as it was given, with its faults told one by one instead of by a seed.
  Result<ShrinkCase> reproduce() {
    FaultRunJob job{.tape = case_.tape.name(), .tracks = true};
    const Result<FaultPool::Done> without = run_alone(job);
    if (!without) return without.error();
    if (const auto failure = failure_of(without->end, case_.fails_by))
      return make_error(Errc::io, fmt::format("without any fault, too, {}", failure->text));
    // Some end when they get no further answer, and so ask once more than there is.
    const bool in_order = without->end.reach >= tape_.parts().size() && !without->end.unknown_hex.empty();
    asks_on_ = without->end.beyond && in_order;
    exact_ = (!without->end.beyond || asks_on_) && !case_.setup.values.contains("rules");
    job.exact = exact_;
    job.faults = case_.faults;
    job.seed = case_.seed;
    const Result<FaultPool::Done> seeded = run_alone(job);
    if (!seeded) return seeded.error();
    if (Result<void> good = check_seeded(seeded->end); !good) return good.error();
    ShrinkCase failing;
    failing.parts.resize(tape_.parts().size());
    std::iota(failing.parts.begin(), failing.parts.end(), std::size_t{0});
    failing.faults = faults_of(seeded->end);
    job.faults = FaultPlan{failing.faults}.text();
    Result<FaultPool::Done> again = run_alone(job);
    if (!again) return again.error();
    failed_ = failed_of(*again);
    if (failed_.kind != failed_of(*seeded).kind)
      return make_error(Errc::io, fmt::format("it fails now and then: {}; and then, with the same faults, {}",
                                              text_of(seeded->end), text_of(again->end)));
    failing.end = std::move(again->end);
    return failing;
  }

  [[nodiscard]] Result<void> check_seeded(const FaultRunEnd& end) const {
    if (!failure_of(end, case_.fails_by))
      return make_error(Errc::io,
                        "it does not fail: under these faults the command ends well; give the plan, the seed "
                        "and the command that soak told");
    if (end.faults_made > FaultPlan::kMostFaults)
      return make_error(Errc::usage,
                        fmt::format("{} faults were made in the run, more than {}; take a lower p",
                                    end.faults_made, FaultPlan::kMostFaults));
    return {};
  }

  [[nodiscard]] std::string text_of(const FaultRunEnd& end) const {
    const auto failure = failure_of(end, case_.fails_by);
    return failure ? failure->text : "the command ended well";
  }

  static std::vector<Fault> faults_of(const FaultRunEnd& end) {
    std::vector<Fault> faults;
    for (const std::string& spec : end.faults) {
      if (const Result<FaultPlan> plan = parse_fault_plan(spec, {}))
        faults.insert(faults.end(), plan->faults.begin(), plan->faults.end());
    }
    return faults;
  }

  [[nodiscard]] Failed failed_of(const FaultPool::Done& done) const {
    const auto failure = failure_of(done.end, case_.fails_by);
    const bool by_itself = failure && failure->kind.starts_with("status");
    return {failure ? failure->kind : "", by_itself ? head_of_last_line(done.output) : "",
            done.end.unknown_hex};
  }

  Result<FaultPool::Done> run_alone(const FaultRunJob& job) {
    ++runs_;
    return pool_.run(job);
  }

  // The runs of the cases go on side by side; of those that fail the first counts.
  std::optional<std::size_t> try_all(std::vector<ShrinkCase>& cases) {
    Round round{.cases = cases, .over = std::vector<bool>(cases.size(), false)};
    for (;;) {
      while (!round.found && round.tapes.size() < cases.size() && round.runs.size() < case_.jobs && !trouble_)
        begin(round);
      const bool decided = round.found && round.is_first(*round.found);
      if (trouble_ || decided || round.runs.empty()) break;
      std::optional<FaultPool::Done> done = pool_.wait(verb_clock().now() + FaultPool::kProgress);
      if (pool_.interrupted_by() != 0) break;
      show_progress();
      if (done) take(round, std::move(*done));
    }
    pool_.cancel();
    for (const std::string& tape : round.tapes) remove(tape);
    const bool sure = round.found && round.is_first(*round.found);
    return sure ? round.found : std::nullopt;
  }

  void begin(Round& round) {
    const std::size_t index = round.tapes.size();
    const std::string tape = fmt::format("{}/{}.log", path_, runs_);
    round.tapes.push_back(tape);
    const ShrinkCase& one = round.cases[index];
    if (Result<void> written = tape_.write(literal_tape(tape), one.parts, false); !written) {
      trouble_ = written.error();
      return;
    }
    FaultRunJob job{.tape = tape, .faults = FaultPlan{one.faults}.text(), .tracks = true, .exact = exact_};
    job.ends_at_unknown = failed_.unknown_hex.empty() && !asks_on_;
    add(round, job, {index, false});
  }

  void add(Round& round, const FaultRunJob& job, Run run) {
    ++runs_;
    round.runs.emplace(pool_.add(job), run);
  }

  void take(Round& round, FaultPool::Done done) {
    const auto ended = round.runs.extract(done.job);
    if (!ended) return;
    const Run run = ended.mapped();
    ShrinkCase& one = round.cases[run.index];
    bool fails = done.trouble.empty();
    if (run.without_faults) {
      fails = fails && (!failure_of(done.end, case_.fails_by) || done.end.reach > one.end.reach);
    } else {
      fails = fails && fails_so(done);
      if (fails) one.end = std::move(done.end);
      if (fails && !is_beginning(one)) return check_without_faults(round, run.index);
    }
    round.over[run.index] = !fails;
    if (fails && (!round.found || run.index < *round.found)) round.found = run.index;
  }

  // It fails as the given case does, and asked nothing else that is not on the tape.
  [[nodiscard]] bool fails_so(const FaultPool::Done& done) const {
    const Failed how = failed_of(done);
    const bool known = asks_on_ || how.unknown_hex.empty() || how.unknown_hex == failed_.unknown_hex;
    return !done.end.enough && known && how.kind == failed_.kind && how.words == failed_.words;
  }

  // The tape's first exchanges, and it wanted no more: that it comes further without faults has been seen.
  static bool is_beginning(const ShrinkCase& one) {
    return one.parts.back() + 1 == one.parts.size() && !one.end.beyond;
  }

  // Else what was left out could be the reason: without its faults the driver must come through, or further.
  void check_without_faults(Round& round, std::size_t index) {
    add(round,
        {.tape = round.tapes[index],
         .tracks = true,
         .exact = exact_,
         .enough = round.cases[index].end.reach + 1},
        {index, true});
  }

  static void remove(const std::string& tape) {
    std::error_code ignored;
    for (const char file : {'r', 'w', 'e'}) std::filesystem::remove(tape + file, ignored);
  }

  void show_progress() {
    const Instant at = verb_clock().now();
    if (!shows_progress_ || at - shown_ < FaultPool::kProgress) return;
    shown_ = at;
    fmt::print(err_, "\rporttape shrink: {} runs ", runs_);
    err_ << std::flush;
    shown_any_ = true;
  }
  void clear_progress() {
    if (std::exchange(shown_any_, false)) err_ << "\r\033[K" << std::flush;
  }

  int interrupted() {
    clear_progress();
    fmt::print(err_, "porttape shrink: interrupted by {} after {} runs\n",
               signal_text(pool_.interrupted_by()), runs_);
    return 128 + pool_.interrupted_by();
  }

  int tell(const ShrinkCase& given, const ShrinkCase& best) {
    const std::string faults = FaultPlan{best.faults}.text();
    const std::string repeat = test_line(case_, output_.name(), faults, 0);
    if (case_.as_json) {
      const auto pair = [](std::size_t left, std::size_t of) {
        return JsonObject().add("left", left).add("of", of);
      };
      out_ << JsonObject()
                  .add("tape", output_.name())
                  .add("exchanges", pair(best.parts.size(), given.parts.size()))
                  .add("faults", pair(best.faults.size(), given.faults.size()))
                  .add("plan", faults)
                  .add("failure", text_of(best.end))
                  .add("runs", runs_)
                  .add("repeat", repeat)
                  .str()
           << '\n';
      return output_status(out_, exit_status::kPass);
    }
    fmt::print(out_, "{} of {} exchanges and {} of {} faults are enough: {} (runs: {})\n", best.parts.size(),
               given.parts.size(), best.faults.size(), given.faults.size(), printable_line(text_of(best.end)),
               runs_);
    fmt::print(out_, "  tape      {}\n  faults    {}\n  repeat    {}\n", printable_line(output_.name()),
               faults, repeat);
    return output_status(out_, exit_status::kPass);
  }

  FaultCase case_;
  TapePaths output_;
  TapeParts tape_;
  FaultPool pool_;
  std::ostream& out_;
  std::ostream& err_;
  PrivateFolder folder_;  // of the tapes that are tried
  std::string path_;
  Failed failed_;
  bool exact_ = true;     // requests are told by their bytes
  bool asks_on_ = false;  // the driver asks more than the tape has, and ends well then
  std::optional<Error> trouble_;
  std::uint64_t runs_ = 0;
  Instant shown_{};
  bool shows_progress_;
  bool shown_any_ = false;
};

Result<int> shrink(CommandVerbLine line, std::ostream& out, std::ostream& err) {
  const auto output = line.values.extract(std::string(kOutput.name));
  if (!output)
    return make_error(Errc::usage, "option 'output' is missing: -o NAME, the tape that is to be written");
  if (!line.values.contains("faults"))
    return make_error(Errc::usage,
                      "option 'faults' is missing: the plan under which the command fails; porttape soak "
                      "finds one");
  Result<FaultCase> the_case = read_fault_case(line);
  if (!the_case) return the_case.error();
  const Result<TapePaths> paths = named_new_tape(output.mapped());
  if (!paths) return make_error(Errc::usage, "option 'output': " + paths.error().message);
  if (Result<void> free = TapeWriter::check(*paths, {}); !free) return free.error();
  Result<TapeParts> tape = TapeParts::load(the_case->tape);
  if (!tape) return tape.error();
  if (tape->parts().empty())
    return make_error(Errc::usage, the_case->tape.name() + " has no bytes: there is nothing to leave out");
  Result<FaultPool> pool = FaultPool::make(*the_case);
  if (!pool) return pool.error();
  return Shrink(std::move(*the_case), *paths, std::move(*tape), std::move(*pool), out, err).run();
}

std::vector<OptionSpec> shrink_options() {
  std::vector<OptionSpec> specs = fault_case_options();
  specs.push_back(kOutput);
  return specs;
}

}  // namespace

int run_shrink(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "shrink",
                         .usage = "--tape NAME --faults SPEC -o NAME [options] -- COMMAND…",
                         .about = kShrinkAbout,
                         .options = shrink_options(),
                         .example = "--tape laser --faults p.txt -o small -- ./driver {port}"};
  return run_command_verb(verb, args, out, err,
                          [&](CommandVerbLine line) { return shrink(std::move(line), out, err); });
}

}  // namespace porttape
