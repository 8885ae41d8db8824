#include <algorithm>
#include <map>
#include <vector>

#include "tests/bench/commands.hpp"
#include "tests/bench/pattern.hpp"
#include "tests/bench/rig.hpp"
#include "tests/bench/stats.hpp"
#include "tests/bench/tape_file.hpp"
#include "tests/bench/transfer.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

struct Plan {
  std::uint64_t bytes;
  std::size_t write_size;
  unsigned timeout;
};

struct Samples {
  std::vector<double> mbps, cpu_ms_per_mb;
};

// One line's transfers since its start; each continues the pattern of its direction.
class Session {
 public:
  Session(Rig& rig, const Plan& plan) : rig_(rig), plan_(plan) {}

  void transfer(bool to_driver, bool to_device, Samples& samples) {
    const Watchdog watchdog(plan_.timeout, rig_.name() + ": transfer");
    std::vector<Child> children;
    const std::int64_t cpu_before = rig_.relay_cpu_ns();
    const std::int64_t start = now_ns();
    if (to_driver) start_one(children, rig_.device(), rig_.driver(), sent_to_driver_);
    if (to_device) start_one(children, rig_.driver(), rig_.device(), sent_to_device_);
    for (Child& child : children) {
      if (child.wait() != 0) throw BenchError(rig_.name() + ": transfer failed");
    }
    const double seconds = static_cast<double>(now_ns() - start) / 1e9;
    const double cpu_ms = static_cast<double>(rig_.relay_cpu_ns() - cpu_before) / 1e6;
    const double mb = static_cast<double>(plan_.bytes) * (to_driver && to_device ? 2 : 1) / 1e6;
    samples.mbps.push_back(mb / seconds);
    samples.cpu_ms_per_mb.push_back(cpu_ms / mb);
  }

  void check_tape(const std::string& name) const {
    check_pattern_file(name + "r", Rig::kHandshake, Rig::kHandshake + sent_to_driver_);
    check_pattern_file(name + "w", Rig::kHandshake, Rig::kHandshake + sent_to_device_);
  }

 private:
  void start_one(std::vector<Child>& children, int from, int to, std::uint64_t& offset) const {
    children.push_back(Child::fork([&] { sink(to, offset, plan_.bytes); }));
    children.push_back(Child::fork([&] { flood(from, offset, plan_.bytes, plan_.write_size); }));
    offset += plan_.bytes;
  }

  Rig& rig_;
  const Plan& plan_;
  std::uint64_t sent_to_driver_ = 0;
  std::uint64_t sent_to_device_ = 0;
};

using Results = std::map<std::string, Samples>;  // by direction

void run_once(Rig& rig, const Plan& plan, const std::string& tape, Results& results) {
  rig.start();
  rig.open_driver();
  rig.handshake();
  Session session(rig, plan);
  session.transfer(true, false, results["to_driver"]);
  session.transfer(false, true, results["to_device"]);
  session.transfer(true, true, results["both"]);
  rig.stop();
  if (!tape.empty()) session.check_tape((rig.dir() / tape).string());
}

}  // namespace

int throughput_command(const Arguments& arguments) {
  CommandLine line(
      "Bytes through lines: to the driver, to the device, both at once; received data is checked.\n"
      "Usage: linebench throughput --relay NAME=COMMAND... [--tape NAME=FILE]... [options]\n"
      "  linebench throughput --relay 'socat=socat -r {dir}/r -R {dir}/w PTY,link={driver},raw,echo=0 "
      "FILE:{device},raw,echo=0'\n");
  line.option()("relay", po::value<Arguments>()->composing()->required(), "a line; see linebench rtt")(
      "tape", po::value<Arguments>()->composing(), "that line's tape in its {dir}, checked after each round")(
      "bytes", po::value<std::uint64_t>()->default_value(32 << 20), "a transfer and direction")(
      "write", po::value<std::size_t>()->default_value(4096), "bytes a write, at most 65536")(
      "rounds", po::value<std::size_t>()->default_value(5), "rounds")(
      "timeout", po::value<unsigned>()->default_value(120), "seconds a transfer")(
      "cpu", po::value<int>()->default_value(-1), "run everything on this CPU")(
      "busy", po::value<int>()->default_value(0), "processes that burn CPU meanwhile");
  if (!line.parse(arguments)) return 0;
  const Plan plan{line.get<std::uint64_t>("bytes"),
                  std::clamp<std::size_t>(line.get<std::size_t>("write"), 1, kWindow),
                  line.get<unsigned>("timeout")};
  pin_to_cpu(line.get<int>("cpu"));
  std::map<std::string, std::string> tapes;
  for (const std::string& text : line.list("tape")) tapes[parse_relay(text).name] = parse_relay(text).command;

  std::vector<Rig> rigs;
  const Arguments relays = line.list("relay");
  rigs.reserve(relays.size());
  for (const std::string& text : relays) rigs.emplace_back(parse_relay(text));
  std::vector<Results> results(rigs.size());
  const BusyCores busy(line.get<int>("busy"));
  for (std::size_t round = 0; round < line.get<std::size_t>("rounds"); ++round) {
    for (std::size_t i = 0; i < rigs.size(); ++i) {
      const std::size_t k = (i + round) % rigs.size();
      run_once(rigs[k], plan, tapes[rigs[k].name()], results[k]);
    }
  }
  for (std::size_t i = 0; i < rigs.size(); ++i) {
    for (const auto& [direction, samples] : results[i]) {
      JsonLine()
          .add("name", rigs[i].name())
          .add("direction", direction)
          .add("MBps", median(samples.mbps))
          .add("relay_cpu_ms_per_MB", median(samples.cpu_ms_per_mb))
          .add("MBps_rounds", samples.mbps)
          .print();
    }
  }
  return 0;
}

}  // namespace porttape::bench
