#include <algorithm>
#include <memory>
#include <vector>

#include "tests/bench/commands.hpp"
#include "tests/bench/driver.hpp"
#include "tests/bench/rig.hpp"
#include "tests/bench/stats.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

struct Path {
  std::string name;
  std::unique_ptr<Driver> driver;
  pid_t relay = -1;
  std::vector<double> p50, p99, cpu;  // a value a round, µs
};

// The device: sends back what it reads, whoever opens and closes the line meanwhile.
void echo(int device) {
  Byte data[4096];
  for (;;) {
    const std::size_t n = read_some(device, data, sizeof data);
    if (n == 0) {
      sleep_ms(1);
    } else {
      write_all(device, data, n);
    }
  }
}

void measure_round(Path& path, Measure measure) {
  const Watchdog watchdog(60, path.name + ": round trips");
  (void)path.driver->take({.act = measure.act, .size = measure.size, .count = std::max(1U, measure.warmup)});
  measure.warmup = 0;
  const std::int64_t cpu_before = path.relay > 0 ? cpu_ns(path.relay) : 0;
  const std::vector<double> times = path.driver->take(measure);
  const std::int64_t cpu = path.relay > 0 ? cpu_ns(path.relay) - cpu_before : 0;
  path.p50.push_back(quantile(times, 0.5));
  path.p99.push_back(quantile(times, 0.99));
  path.cpu.push_back(static_cast<double>(cpu) / 1000.0 / static_cast<double>(times.size()));
}

void print(const Path& path) {
  JsonLine()
      .add("name", path.name)
      .add("p50_us", median(path.p50))
      .add("p99_us", median(path.p99))
      .add("relay_cpu_us", median(path.cpu))
      .add("p50_rounds", path.p50)
      .add("p99_rounds", path.p99)
      .print();
}

}  // namespace

int rtt_command(const Arguments& arguments) {
  CommandLine line(
      "Round trips of a blocking ping-pong, the lines in turn each round.\n"
      "Usage: linebench rtt [--relay NAME=COMMAND]... [--driven NAME=COMMAND]... [--path NAME=PORT]... "
      "[options]\n"
      "  linebench rtt --relay bare= --relay 'socat=socat PTY,link={driver},raw,echo=0 "
      "FILE:{device},raw,echo=0'\n");
  line.option()(
      "relay", po::value<Arguments>()->composing(),
      "a line to set up: {driver} link to make, {device} to open, {dir} scratch; no COMMAND: bare pty")(
      "driven", po::value<Arguments>()->composing(),
      "as --relay, and COMMAND runs the driver: ends with `-- linebench drive {port} {dir}`; no {driver}: it "
      "has {device} itself")("path", po::value<Arguments>()->composing(),
                             "a port that exists, with an echo behind it")(
      "size", po::value<std::uint32_t>()->default_value(16), "bytes a message, at most 4096")(
      "count", po::value<std::uint32_t>()->default_value(1000), "round trips a round")(
      "warmup", po::value<std::uint32_t>()->default_value(100), "before them, not counted")(
      "rounds", po::value<std::size_t>()->default_value(11), "rounds")(
      "cpu", po::value<int>()->default_value(-1), "run everything on this CPU")(
      "busy", po::value<int>()->default_value(0), "processes that burn CPU meanwhile");
  if (!line.parse(arguments)) return 0;
  const Measure measure{.act = Act::round_trip,
                        .size = std::clamp(line.get<std::uint32_t>("size"), 1U, 4096U),
                        .warmup = line.get<std::uint32_t>("warmup"),
                        .count = std::max(1U, line.get<std::uint32_t>("count"))};
  pin_to_cpu(line.get<int>("cpu"));

  std::vector<Rig> rigs;
  std::vector<Child> echoes;
  std::vector<UniqueFd> ports;
  std::vector<Path> paths;
  rigs.reserve(line.list("relay").size() + line.list("driven").size());
  for (const std::string& text : line.list("relay")) {
    Rig& rig = rigs.emplace_back(parse_relay(text));
    rig.start();
    echoes.push_back(Child::fork([&rig] { echo(rig.device()); }));
    rig.open_driver();
    paths.push_back({rig.name(), Driver::here(rig.driver()), rig.pid(), {}, {}, {}});
  }
  for (const std::string& text : line.list("driven")) {
    Rig& rig = rigs.emplace_back(parse_relay(text));
    Driver::prepare(rig.dir());
    rig.start();
    echoes.push_back(Child::fork([&rig] { echo(rig.device()); }));
    paths.push_back({rig.name(), Driver::elsewhere(rig.dir()), rig.pid(), {}, {}, {}});
  }
  for (const std::string& text : line.list("path")) {
    const RelaySpec spec = parse_relay(text);
    ports.push_back(open_port(spec.command));
    paths.push_back({spec.name, Driver::here(ports.back().get()), -1, {}, {}, {}});
  }
  if (paths.empty()) throw UsageError("nothing to measure: give --relay, --driven or --path");

  const BusyCores busy(line.get<int>("busy"));
  for (std::size_t round = 0; round < line.get<std::size_t>("rounds"); ++round) {
    for (std::size_t i = 0; i < paths.size(); ++i) measure_round(paths[(i + round) % paths.size()], measure);
  }
  for (const Path& path : paths) print(path);
  return 0;
}

int echo_command(const Arguments& arguments) {
  CommandLine line(
      "A device that sends back what it reads, until it is ended.\n"
      "Usage: linebench echo [PORT]      without PORT: a new pty, its path on stdout\n",
      "port");
  line.option()("port", po::value<std::string>(), "the port to echo on");
  if (!line.parse(arguments)) return 0;
  if (line.has("port")) {
    const UniqueFd port = open_port(line.get<std::string>("port"));
    echo(port.get());
  }
  const Pty pty = make_pty();
  std::printf("%s\n", pty.slave.c_str());
  std::fflush(stdout);
  echo(pty.master.get());
  return 0;
}

}  // namespace porttape::bench
