#include <algorithm>
#include <ctime>
#include <fstream>
#include <poll.h>
#include <sys/prctl.h>
#include <vector>

#include "tests/bench/bare_relay.hpp"
#include "tests/bench/commands.hpp"
#include "tests/bench/pattern.hpp"
#include "tests/bench/rig.hpp"
#include "tests/bench/tape_file.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

constexpr std::size_t kPiece = 64;
constexpr int kLinkMs = 20'000;

struct PtyChannel {
  Pty device;
  UniqueFd driver;
  std::string link, tape;
};

void write_config(const std::vector<PtyChannel>& channels, const std::filesystem::path& dir) {
  std::ofstream out(dir / "config");
  for (std::size_t n = 0; n < channels.size(); ++n) {
    const PtyChannel& channel = channels[n];
    out << "[channel c" << n << "]\ndevice = serial:" << channel.device.slave
        << "\ndriver = pty:" << channel.link << "\ntape = " << channel.tape << "\n";
  }
  if (!out.flush()) throw BenchError("cannot write the configuration");
}

// `files`: the daemon's soft limit of descriptors.
Child start_daemon(const std::string& program, std::size_t files, const std::vector<PtyChannel>& channels,
                   const std::filesystem::path& dir) {
  write_config(channels, dir);
  const std::string limit = "ulimit -S -n " + std::to_string(files) + "; exec \"$@\"";
  return Child::run(
      {"sh", "-c", limit, "sh", program, "run", (dir / "config").string(), "--log-level", "warn"},
      (dir / "output").string());
}

Child start_bare(const std::vector<PtyChannel>& channels) {
  std::vector<BareLine> lines;
  for (const PtyChannel& channel : channels)
    lines.push_back({channel.device.slave, channel.link, channel.tape});
  return Child::fork([lines = std::move(lines)] { relay_bare(lines); });
}

// One byte each way: the channel has opened its device and moves bytes.
void open_driver(PtyChannel& channel) {
  for (int waited = 0; !std::filesystem::exists(channel.link); waited += 10) {
    if (waited > kLinkMs) throw BenchError("no " + channel.link + " was made");
    sleep_ms(10);
  }
  channel.driver = open_port(channel.link);
  Byte got{};
  write_all(channel.driver.get(), pattern_at(0), 1);
  read_exact(channel.device.master.get(), &got, 1);
  write_all(channel.device.master.get(), pattern_at(0), 1);
  read_exact(channel.driver.get(), &got, 1);
}

// One piece after the other at moments that are evenly spread, as if each line had a clock of its own; or
// those of all lines `together`, as from one adapter with many ports.
void send_all(const std::vector<int>& ends, std::uint64_t bytes, std::size_t baud, bool together) {
  ::prctl(PR_SET_TIMERSLACK, 1UL);
  const double apart = 1e9 * static_cast<double>(kPiece) * 10 / static_cast<double>(baud * ends.size());
  const std::int64_t start = now_ns();
  std::uint64_t number = 0;
  for (std::uint64_t at = 1; at <= bytes; at += kPiece) {
    for (const int end : ends) {
      const std::uint64_t turn = together ? number / ends.size() * ends.size() : number;
      ++number;
      const std::int64_t due = start + static_cast<std::int64_t>(apart * static_cast<double>(turn));
      const timespec moment{due / 1'000'000'000, due % 1'000'000'000};
      if (due > now_ns()) ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &moment, nullptr);
      write_all(end, pattern_at(at), kPiece);
    }
    check_signals();
  }
}

// Takes what has come once a millisecond, so that the measuring leaves the processor to what is measured.
void receive_all(const std::vector<int>& ends, std::uint64_t bytes) {
  std::vector<pollfd> polls;
  for (const int end : ends) polls.push_back({end, POLLIN, 0});
  std::vector<std::uint64_t> got(ends.size(), 0);
  Bytes buffer(kWindow);
  for (std::size_t open = ends.size(); open > 0; sleep_ms(1)) {
    if (::poll(polls.data(), polls.size(), -1) < 0) check_signals();
    for (std::size_t n = 0; n < polls.size(); ++n) {
      if (polls[n].revents == 0) continue;
      const std::size_t size = read_some(polls[n].fd, buffer.data(), buffer.size());
      if (size == 0 || !is_pattern(1 + got[n], buffer.data(), size))
        throw BenchError("line " + std::to_string(n) + ": wrong after byte " + std::to_string(got[n]));
      got[n] += size;
      if (got[n] < bytes) continue;
      polls[n].fd = -1;
      --open;
    }
  }
}

struct Idle {
  double cpu_percent;
  double wakeups_per_s;
};

Idle watch_idle(pid_t pid, double seconds) {
  sleep_ms(1500);  // what follows an open is over
  const std::int64_t cpu = cpu_ns(pid);
  const std::uint64_t switches = context_switches(pid);
  const std::int64_t start = now_ns();
  sleep_ms(static_cast<int>(seconds * 1000));
  const double passed = static_cast<double>(now_ns() - start) / 1e9;
  return {static_cast<double>(cpu_ns(pid) - cpu) / 1e7 / passed,
          static_cast<double>(context_switches(pid) - switches) / passed};
}

}  // namespace

int ptys_command(const Arguments& arguments) {
  CommandLine line(
      "Many channels (serial device, pty for the driver) in one recording daemon, first idle with all "
      "drivers "
      "open, then some of them with traffic both ways in pieces of 64 bytes; bytes and tapes are checked.\n"
      "Usage: linebench ptys [--daemon porttaped] [--channels 256] [--talking 64] [--baud 115200] [--seconds "
      "5] [--together]\n");
  line.option()("daemon", po::value<std::string>(),
                "the program; without it a bare loop of reads and writes")(
      "channels", po::value<std::size_t>()->default_value(256), "how many")(
      "talking", po::value<std::size_t>()->default_value(64), "how many of them have traffic")(
      "baud", po::value<std::size_t>()->default_value(115200), "of the traffic, each way")(
      "files", po::value<std::size_t>()->default_value(1024), "the daemon's soft limit of descriptors")(
      "idle", po::value<double>()->default_value(3), "seconds without traffic")(
      "seconds", po::value<std::size_t>()->default_value(5), "of traffic")(
      "together", po::bool_switch(), "the pieces of all lines come at the same moments");
  if (!line.parse(arguments)) return 0;
  const auto baud = line.get<std::size_t>("baud");
  const auto seconds = line.get<std::size_t>("seconds");
  const std::size_t talking = std::min(line.get<std::size_t>("talking"), line.get<std::size_t>("channels"));
  if (talking == 0 || baud < kPiece * 10) throw UsageError("--talking and --baud must give some traffic");
  const bool together = line.get<bool>("together");
  const std::uint64_t bytes = baud * seconds / 10 / kPiece * kPiece;
  const ScratchDir dir;
  std::vector<PtyChannel> channels(line.get<std::size_t>("channels"));
  for (std::size_t n = 0; n < channels.size(); ++n) {
    const std::string name = (dir.path() / ("c" + std::to_string(n))).string();
    channels[n] = {make_pty(), {}, name, name + ".log"};
  }
  const bool bare = !line.has("daemon");
  Child daemon = bare ? start_bare(channels)
                      : start_daemon(line.get<std::string>("daemon"), line.get<std::size_t>("files"),
                                     channels, dir.path());
  const Watchdog watchdog(static_cast<unsigned>(60 + 4 * seconds), "ptys");
  for (PtyChannel& channel : channels) open_driver(channel);
  const Idle idle = watch_idle(daemon.pid(), line.get<double>("idle"));
  std::vector<int> ends;
  for (std::size_t n = 0; n < talking; ++n) {
    ends.push_back(channels[n].device.master.get());
    ends.push_back(channels[n].driver.get());
  }
  const std::int64_t cpu_before = cpu_ns(daemon.pid());
  const std::uint64_t switches_before = context_switches(daemon.pid());
  const std::int64_t start = now_ns();
  Child receiver = Child::fork([&] { receive_all(ends, bytes); });
  Child sender = Child::fork([&] { send_all(ends, bytes, baud, together); });
  if (sender.wait() != 0 || receiver.wait() != 0) throw BenchError("a channel failed");
  const double passed = static_cast<double>(now_ns() - start) / 1e9;
  const auto cpu = static_cast<double>(cpu_ns(daemon.pid()) - cpu_before);
  const auto switches = static_cast<double>(context_switches(daemon.pid()) - switches_before);
  const std::uint64_t peak = peak_rss_kib(daemon.pid());
  if (bare) {
    daemon.stop();
  } else {
    stop_daemon(daemon, dir.path() / "output");
  }
  for (std::size_t n = 0; n < talking; ++n) {
    for (const char* const file : {"r", "w"}) check_pattern_file(channels[n].tape + file, 0, bytes + 1);
  }
  const double pieces = static_cast<double>(bytes / kPiece * ends.size());
  JsonLine()
      .add("channels", std::uint64_t{channels.size()})
      .add("talking", std::uint64_t{talking})
      .add("idle_cpu_percent", idle.cpu_percent)
      .add("idle_wakeups_per_s", idle.wakeups_per_s)
      .add("bytes", bytes)
      .add("seconds", passed)
      .add("cpu_percent", cpu / 1e7 / passed)
      .add("cpu_us_per_piece", cpu / 1e3 / pieces)
      .add("wakeups_per_piece", switches / pieces)
      .add("peak_kib", peak)
      .print();
  return 0;
}

}  // namespace porttape::bench
