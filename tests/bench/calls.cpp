#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "tests/bench/commands.hpp"
#include "tests/bench/driver.hpp"
#include "tests/bench/rig.hpp"
#include "tests/bench/stats.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

struct KindOfCall {
  const char* name;
  Act act;
  bool trapped;  // else less than a look at the clock
};
constexpr std::array<KindOfCall, 6> kKinds{{{"TIOCMGET", Act::modem_get, true},
                                            {"TIOCMBIC", Act::modem_clear, true},
                                            {"TCGETS", Act::settings, true},
                                            {"TCGETS of another file", Act::elsewhere, true},
                                            {"FIONREAD", Act::queued, false},
                                            {"getppid", Act::parent, false}}};
constexpr std::uint32_t kCallsAtOnce = 64;

struct Times {
  std::vector<double> p50, p99;  // a value a round, µs
};

void measure_calls(const std::string& name, Driver& driver, const KindOfCall& kind, std::uint32_t count,
                   Times& times) {
  const Watchdog watchdog(60, name + ": " + kind.name);
  const std::vector<double> taken = driver.take(
      {.act = kind.act, .warmup = count / 10, .count = count, .calls = kind.trapped ? 1 : kCallsAtOnce});
  times.p50.push_back(quantile(taken, 0.5));
  times.p99.push_back(quantile(taken, 0.99));
}

}  // namespace

int calls_command(const Arguments& arguments) {
  CommandLine line(
      "What a driver's calls take: bare, and run by COMMAND, in turn each round.\n"
      "Usage: linebench calls --driven NAME=COMMAND [options]\n"
      "  linebench calls --driven 'exec=porttape exec --device serial:{device} --driver pty:{driver} -- "
      "linebench drive {port} {dir}'\n");
  line.option()("driven", po::value<std::string>()->required(),
                "NAME=COMMAND, as of linebench rtt: ends with `-- linebench drive {port} {dir}`")(
      "count", po::value<std::uint32_t>()->default_value(1000), "times a round of each call")(
      "rounds", po::value<std::size_t>()->default_value(11), "rounds");
  if (!line.parse(arguments)) return 0;
  const std::uint32_t count = std::max(1U, line.get<std::uint32_t>("count"));

  const Pty pty = make_pty();
  const UniqueFd port = open_port(pty.slave);
  const std::unique_ptr<Driver> bare = Driver::here(port.get());
  Rig rig(parse_relay(line.get<std::string>("driven")));
  Driver::prepare(rig.dir());
  rig.start();
  const std::unique_ptr<Driver> driven = Driver::elsewhere(rig.dir());

  std::array<Times, kKinds.size()> without;
  std::array<Times, kKinds.size()> with;
  for (std::size_t round = 0; round < line.get<std::size_t>("rounds"); ++round) {
    for (std::size_t i = 0; i < kKinds.size(); ++i) {
      measure_calls("bare", *bare, kKinds.at(i), count, without.at(i));
      measure_calls(rig.name(), *driven, kKinds.at(i), count, with.at(i));
    }
  }
  for (std::size_t i = 0; i < kKinds.size(); ++i) {
    JsonLine()
        .add("call", std::string(kKinds.at(i).name))
        .add("trapped", std::int64_t{kKinds.at(i).trapped})
        .add("bare_p50_us", median(without.at(i).p50))
        .add("p50_us", median(with.at(i).p50))
        .add("p99_us", median(with.at(i).p99))
        .add("bare_rounds", without.at(i).p50)
        .add("p50_rounds", with.at(i).p50)
        .print();
  }
  return 0;
}

}  // namespace porttape::bench
