#include <algorithm>
#include <sys/prctl.h>
#include <vector>

#include "tests/bench/commands.hpp"
#include "tests/bench/rig.hpp"
#include "tests/bench/stats.hpp"
#include "tests/bench/tape_file.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

struct Stamps {
  std::int64_t before_open = 0;
  std::int64_t after_open = 0;
  std::vector<std::int64_t> arrived;  // when the read returned that brought the block's last byte
};

void receive(int fd, const std::vector<Arrival>& due, Stamps& stamps) {
  Byte buffer[65536];
  std::uint64_t got = 0;
  stamps.arrived.reserve(due.size());
  while (stamps.arrived.size() < due.size()) {
    const std::size_t n = read_some(fd, buffer, sizeof buffer);
    const std::int64_t now = now_ns();
    if (n == 0) throw BenchError("the line hung up after " + std::to_string(got) + " bytes");
    got += n;
    while (stamps.arrived.size() < due.size() && due[stamps.arrived.size()].end <= got)
      stamps.arrived.push_back(now);
  }
}

// The floor: this program itself writes each block into a pty at its time, by an absolute sleep.
Child start_floor_player(int master, const std::vector<Arrival>& due, std::int64_t zero) {
  return Child::fork([&due, master, zero] {
    ::prctl(PR_SET_TIMERSLACK, 1UL);
    const Bytes bytes(65536);
    std::uint64_t begin = 0;
    for (const Arrival& arrival : due) {
      const std::int64_t at = zero + arrival.time_us * 1000;
      const timespec until{at / 1'000'000'000, at % 1'000'000'000};
      ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
      write_all(master, bytes.data(), static_cast<std::size_t>(arrival.end - begin));
      begin = arrival.end;
    }
    sleep_ms(500);  // the master stays open until all is read
  });
}

void print(const std::string& name, const std::vector<Arrival>& due, const Stamps& stamps, double rate) {
  std::vector<double> late;
  for (std::size_t i = 0; i < due.size(); ++i) {
    const auto passed = static_cast<double>(stamps.arrived[i] - stamps.before_open) / 1000.0;
    late.push_back(passed - static_cast<double>(due[i].time_us) / rate);
  }
  JsonLine()
      .add("name", name)
      .add("blocks", static_cast<std::uint64_t>(due.size()))
      .add("late_min_us", *std::min_element(late.begin(), late.end()))
      .add("late_p50_us", quantile(late, 0.5))
      .add("late_p99_us", quantile(late, 0.99))
      .add("late_max_us", *std::max_element(late.begin(), late.end()))
      .add("open_call_us", static_cast<double>(stamps.after_open - stamps.before_open) / 1000.0)
      .print();
}

}  // namespace

int arrivals_command(const Arguments& arguments) {
  CommandLine line(
      "When a replay's blocks arrive, against the times on the tape. Time counts from just before the "
      "client's open(), so a\n"
      "value below 0 is surely early; the daemon's notice of the open is part of the lateness.\n"
      "Usage: linebench arrivals --tape NAME (--relay NAME=COMMAND | --path PORT | --floor)\n"
      "  linebench arrivals --tape t.log --relay 'replay=porttaped replay --tape t.log --driver pty:{driver} "
      "--once'\n");
  line.option()("tape", po::value<std::string>()->required(), "the tape that is played, as in laser.log")(
      "relay", po::value<std::string>(), "NAME=COMMAND to start")("path", po::value<std::string>(),
                                                                  "a port that plays it")(
      "floor", po::bool_switch(), "no relay: this program plays the tape itself, by absolute sleeps")(
      "rate", po::value<double>()->default_value(1), "time runs this many times as fast")(
      "wait", po::bool_switch(), "the relay ends by itself after the close (--once): print its exit status")(
      "timeout", po::value<unsigned>()->default_value(120), "seconds")(
      "busy", po::value<int>()->default_value(0), "processes that burn CPU meanwhile");
  if (!line.parse(arguments)) return 0;
  if (int{line.has("relay")} + int{line.has("path")} + int{line.get<bool>("floor")} != 1) {
    throw UsageError("give one of --relay, --path and --floor");
  }
  const std::vector<Arrival> due = arrivals_of(line.get<std::string>("tape"));
  if (due.empty()) throw BenchError("the tape has no read blocks");
  const double rate = line.get<double>("rate");
  const BusyCores busy(line.get<int>("busy"));
  Stamps stamps;
  if (line.get<bool>("floor")) {
    const Watchdog watchdog(line.get<unsigned>("timeout"), "arrivals");
    const Pty pty = make_pty();
    const UniqueFd port = open_port(pty.slave);
    stamps.before_open = stamps.after_open = now_ns();
    const Child player = start_floor_player(pty.master.get(), due, stamps.before_open);
    receive(port.get(), due, stamps);
    print("floor", due, stamps, 1);
    return 0;
  }
  Rig rig(line.has("relay") ? parse_relay(line.get<std::string>("relay")) : RelaySpec{"path", ""});
  rig.start();
  const std::string path = line.has("path") ? line.get<std::string>("path") : rig.driver_path();
  {
    const Watchdog watchdog(line.get<unsigned>("timeout"), "arrivals");
    stamps.before_open = now_ns();
    const UniqueFd port = open_port(path);
    stamps.after_open = now_ns();
    receive(port.get(), due, stamps);
  }
  print(rig.name(), due, stamps, rate);
  if (line.get<bool>("wait"))
    JsonLine().add("name", rig.name()).add("exit", std::int64_t{rig.wait()}).print();
  return 0;
}

}  // namespace porttape::bench
