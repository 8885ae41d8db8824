#include <algorithm>
#include <sys/resource.h>

#include "tests/bench/commands.hpp"
#include "tests/bench/rig.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

void watch_idle(Rig& rig, const std::string& state, double seconds) {
  sleep_ms(1500);  // what follows an open or close is over
  if (!rig.alive()) {
    JsonLine().add("name", rig.name()).add("driver", state).add("ended", std::int64_t{rig.stop()}).print();
    return;
  }
  const std::int64_t cpu_before = rig.relay_cpu_ns();
  const std::uint64_t wakeups_before = wakeups(rig.pid());
  const std::int64_t start = now_ns();
  sleep_ms(static_cast<int>(seconds * 1000));
  const double passed = static_cast<double>(now_ns() - start) / 1e9;
  const auto cpu = static_cast<double>(rig.relay_cpu_ns() - cpu_before);
  JsonLine()
      .add("name", rig.name())
      .add("driver", state)
      .add("cpu_percent", cpu / 1e7 / passed)
      .add("wakeups_per_s", static_cast<double>(wakeups(rig.pid()) - wakeups_before) / passed)
      .print();
}

}  // namespace

int idle_command(const Arguments& arguments) {
  CommandLine line(
      "What a relay uses while no byte moves: before the driver's first open, while it is open, and after "
      "its close.\n"
      "Usage: linebench idle --relay NAME=COMMAND [--seconds 5]\n");
  line.option()("relay", po::value<Arguments>()->composing()->required(), "a line; see linebench rtt")(
      "seconds", po::value<double>()->default_value(5), "each state");
  if (!line.parse(arguments)) return 0;
  for (const std::string& text : line.list("relay")) {
    Rig rig(parse_relay(text));
    if (!rig.has_process()) throw UsageError("'" + text + "' has no process to watch");
    const auto seconds = line.get<double>("seconds");
    rig.start();
    watch_idle(rig, "never", seconds);
    rig.open_driver();
    rig.handshake();
    watch_idle(rig, "open", seconds);
    rig.close_driver();
    watch_idle(rig, "closed", seconds);
  }
  return 0;
}

int peak_command(const Arguments& arguments) {
  const auto dashes = std::find(arguments.begin(), arguments.end(), "--");
  CommandLine line(
      "Runs a program and prints its wall and CPU time, exit status and peak resident memory.\n"
      "Usage: linebench peak -- PROGRAM [argument]...\n");
  if (!line.parse(Arguments(arguments.begin(), dashes))) return 0;
  if (dashes == arguments.end() || dashes + 1 == arguments.end()) throw UsageError("no program after --");
  const std::int64_t start = now_ns();
  Child child = Child::run(Arguments(dashes + 1, arguments.end()), "/dev/null");
  std::uint64_t peak = 0;
  while (!child.poll()) {
    peak = std::max(peak, peak_rss_kib(child.pid()));
    sleep_ms(1);
  }
  const double seconds = static_cast<double>(now_ns() - start) / 1e9;
  rusage used{};
  ::getrusage(RUSAGE_CHILDREN, &used);
  const auto cpu_us = static_cast<double>((used.ru_utime.tv_sec + used.ru_stime.tv_sec) * 1'000'000 +
                                          used.ru_utime.tv_usec + used.ru_stime.tv_usec);
  JsonLine()
      .add("exit", std::int64_t{child.wait()})
      .add("seconds", seconds)
      .add("cpu_s", cpu_us / 1e6)
      .add("peak_kib", peak)
      .print();
  return 0;
}

}  // namespace porttape::bench
