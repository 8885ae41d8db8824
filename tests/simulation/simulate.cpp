// Runs seeds of the simulation, see --help.

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <iostream>
#include <limits>
#include <optional>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <boost/program_options.hpp>

#include "tests/simulation/seed.hpp"

namespace {

using porttape::simulation::run_seed;
using porttape::simulation::SeedResult;

constexpr int kMostFindings = 20;
constexpr std::uint64_t kNoEnd = std::numeric_limits<std::uint64_t>::max() - 1;  // all can be counted

struct Options {
  std::uint64_t first = 1;
  std::uint64_t last = 500;
  unsigned jobs = 1;
  std::optional<std::chrono::steady_clock::time_point> until = {};  // a job begins none then but its first
  std::vector<std::uint64_t> kept = {};                             // these instead
  bool trace = false;
  bool stop = false;

  [[nodiscard]] std::uint64_t count() const { return kept.empty() ? last - first + 1 : kept.size(); }
  [[nodiscard]] std::uint64_t seed(std::uint64_t n) const { return kept.empty() ? first + n : kept[n]; }
};

// Of a job: each of so many jobs takes the seeds in turn.
struct Share {
  std::uint64_t from = 0;
  std::uint64_t step = 1;
  pid_t parent = 0;  // it ends when that process has; 0: it has none
};

struct Sum {
  std::uint64_t seeds = 0;
  std::uint64_t last = 0;  // the highest one
  std::uint64_t findings = 0;
  double seconds = 0;  // simulated
};

// In memory where that can be had: a seed makes and removes some files.
std::filesystem::path make_folder() {
  const char* const given = std::getenv("TMPDIR");
  const bool memory = given == nullptr && ::access("/dev/shm", W_OK) == 0;
  std::string name = fmt::format("{}/porttape-simulation.XXXXXX", memory             ? "/dev/shm"
                                                                  : given != nullptr ? given
                                                                                     : "/tmp");
  if (::mkdtemp(name.data()) == nullptr) {
    std::cerr << "simulate: cannot make " << name << '\n';
    std::exit(2);
  }
  return name;
}

// A seed takes some milliseconds. One in which the program goes on without an end and without a wait is
// ended.
constexpr unsigned kSeedLimit = 60;  // seconds of the real clock
std::uint64_t seed_under_way = 0;

void on_alarm(int) {
  char text[64];
  const auto end = fmt::format_to_n(text, sizeof text, "seed {}: the program does not end\n", seed_under_way);
  const bool told = ::write(STDOUT_FILENO, text, std::min(end.size, sizeof text)) > 0;
  ::_exit(told ? 1 : 2);
}

Sum run_seeds(const Options& options, Share share, const char* program) {
  const std::filesystem::path folder = make_folder();
  std::signal(SIGALRM, on_alarm);
  Sum sum;
  for (std::uint64_t n = share.from; n < options.count(); n += share.step) {
    const bool late = options.until && std::chrono::steady_clock::now() >= *options.until;
    if ((late && n != share.from) || (share.parent != 0 && ::getppid() != share.parent)) break;
    const std::uint64_t seed = options.seed(n);
    seed_under_way = seed;
    ::alarm(kSeedLimit);
    const SeedResult result = run_seed(seed, folder / "seed", options.trace);
    ++sum.seeds;
    sum.last = std::max(sum.last, seed);
    sum.seconds += result.seconds;
    std::string text;
    for (const std::string& line : result.trace) text += line + '\n';
    if (!result.trouble.empty()) {
      ++sum.findings;
      text += fmt::format("seed {}: {}\n  {} --seed {} --trace\n", seed, result.trouble, program, seed);
    }
    std::cout << text << std::flush;
    if (sum.findings >= kMostFindings || (options.stop && sum.findings > 0)) break;
  }
  ::alarm(0);
  std::filesystem::remove_all(folder);
  return sum;
}

// One process a job, since one process has one simulated system. None when a job died.
std::optional<Sum> run_jobs(const Options& options, const char* program) {
  if (options.jobs == 1) return run_seeds(options, {}, program);
  struct Job {
    pid_t pid;
    int from;
  };
  std::vector<Job> jobs;
  const pid_t parent = ::getpid();
  for (unsigned n = 0; n < options.jobs; ++n) {
    int ends[2];
    if (::pipe(ends) != 0) return std::nullopt;
    const pid_t pid = ::fork();
    if (pid == 0) {
      const Sum sum = run_seeds(options, {n, options.jobs, parent}, program);
      const bool told = ::write(ends[1], &sum, sizeof sum) == sizeof sum;
      ::_exit(told ? 0 : 1);
    }
    ::close(ends[1]);
    if (pid > 0) jobs.push_back({pid, ends[0]});
  }
  std::optional<Sum> all = Sum{};
  if (jobs.size() < options.jobs) all.reset();
  for (const Job& job : jobs) {
    Sum sum;
    const bool told = ::read(job.from, &sum, sizeof sum) == sizeof sum;
    ::close(job.from);
    int status = 0;
    ::waitpid(job.pid, &status, 0);
    if (!told || status != 0) {
      std::cout << (WIFSIGNALED(status) ? fmt::format("a job died of signal {}", WTERMSIG(status))
                                        : "a job died")
                << "; --jobs 1 shows the seed\n";
      all.reset();
    } else if (all) {
      all->seeds += sum.seeds;
      all->last = std::max(all->last, sum.last);
      all->findings += sum.findings;
      all->seconds += sum.seconds;
    }
  }
  return all;
}

std::vector<std::uint64_t> read_kept(const std::string& name) {
  std::ifstream file(name);
  std::vector<std::uint64_t> seeds;
  std::string line;
  while (std::getline(file, line)) {
    if (!line.empty() && line[0] != '#') seeds.push_back(std::stoull(line));
  }
  if (seeds.empty()) throw std::invalid_argument(name + " has no seeds");
  return seeds;
}

std::optional<int> read_options(int argc, char** argv, Options& options) {
  namespace po = boost::program_options;
  std::string seeds = "1..500";
  po::options_description known("Options");
  known.add_options()("seeds", po::value(&seeds)->value_name("A..B"),
                      "which ones; 1..500 unless given; A.. has no end")(
      "for", po::value<unsigned>()->value_name("SECONDS"), "as many of them as can be begun in that time")(
      "seed", po::value<std::uint64_t>()->value_name("N"), "one seed")(
      "kept", po::value<std::string>()->value_name("FILE"),
      "those of a file: one a line, and what it is about")("trace", "prints what happens in each seed")(
      "jobs", po::value(&options.jobs)->value_name("N"), "processes; one a processor unless given")(
      "stop", "ends a job at its first finding")("help,h", "this text");
  options.jobs = std::max(1U, std::thread::hardware_concurrency());
  po::variables_map given;
  try {
    po::store(po::parse_command_line(argc, argv, known), given);
    po::notify(given);
    if (given.contains("help")) {
      std::cout << "usage: simulate [--seeds A..B | --kept FILE] [--for SECONDS] [--jobs N] [--stop]\n"
                   "       simulate --seed N [--trace]\n\n"
                   "Runs a whole daemon in a simulated world, once a seed: what drivers, devices, disks and "
                   "users do is\n"
                   "chance, time is simulated, and what must always hold is checked. Exit status 0: it held "
                   "in all seeds,\n"
                   "1: it did not; the seed and the command that repeats it are printed.\n\n"
                << known;
      return 0;
    }
    const std::size_t dots = seeds.find("..");
    if (dots == std::string::npos) throw std::invalid_argument("seeds");
    if (given.contains("kept")) options.kept = read_kept(given["kept"].as<std::string>());
    options.first = given.contains("seed") ? given["seed"].as<std::uint64_t>() : std::stoull(seeds);
    const std::string last = seeds.substr(dots + 2);
    options.last = given.contains("seed") ? options.first : last.empty() ? kNoEnd : std::stoull(last);
    if (given.contains("for"))
      options.until = std::chrono::steady_clock::now() + std::chrono::seconds(given["for"].as<unsigned>());
    if (options.last < options.first || (options.last == kNoEnd && !options.until))
      throw std::invalid_argument("--seeds " + seeds + ": there is none, or no end without --for");
  } catch (const std::exception& error) {
    std::cerr << "simulate: " << error.what() << "; see --help\n";
    return 2;
  }
  options.trace = given.contains("trace");
  options.stop = given.contains("stop");
  if (options.first == options.last || options.jobs == 0) options.jobs = 1;
  return std::nullopt;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  if (const std::optional<int> status = read_options(argc, argv, options)) return *status;
  const auto begin = std::chrono::steady_clock::now();
  const std::optional<Sum> sum = run_jobs(options, argv[0]);
  if (!sum) return 1;
  const double took = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  // Which ones, so that they can be repeated.
  if (options.until && options.kept.empty())
    std::cout << fmt::format("seeds {}..{}: ", options.first, sum->last);
  std::cout << fmt::format("{} seeds, {:.1f} simulated hours in {:.1f} s ({:.0f} seeds/s): {} findings\n",
                           sum->seeds, sum->seconds / 3600, took, static_cast<double>(sum->seeds) / took,
                           sum->findings);
  return sum->findings == 0 ? 0 : 1;
}
