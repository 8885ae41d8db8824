#include <fstream>
#include <poll.h>
#include <vector>

#include "tests/bench/commands.hpp"
#include "tests/bench/pattern.hpp"
#include "tests/bench/rig.hpp"
#include "tests/bench/tape_file.hpp"
#include "tests/bench/tcp_line.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

constexpr int kTickMs = 10;
constexpr int kStartMs = 10'000;

struct Channel {
  UniqueFd listener, device, driver;
  std::uint16_t driver_port = 0;
  std::uint64_t got = 0;
};

// The configuration of a daemon that records all channels.
void write_config(const std::vector<Channel>& channels, const std::filesystem::path& dir) {
  std::ofstream out(dir / "config");
  for (std::size_t n = 0; n < channels.size(); ++n) {
    out << "[channel c" << n << "]\ndevice = tcp:127.0.0.1:" << tcp_port(channels[n].listener.get())
        << "\ndriver = tcp-listen:127.0.0.1:" << channels[n].driver_port
        << "\ntape = " << (dir / ("c" + std::to_string(n) + ".log")).string() << "\n";
  }
  if (!out.flush()) throw BenchError("cannot write the configuration");
}

// Every device sends its part at each tick.
void send_all(const std::vector<Channel>& channels, std::uint64_t bytes, std::size_t a_tick) {
  const std::int64_t start = now_ns();
  for (std::uint64_t sent = 0, tick = 0; sent < bytes; sent += a_tick, ++tick) {
    for (const Channel& channel : channels) write_all(channel.device.get(), pattern_at(sent), a_tick);
    const std::int64_t wait = start + static_cast<std::int64_t>(tick + 1) * kTickMs * 1'000'000 - now_ns();
    if (wait > 0) sleep_ms(static_cast<int>(wait / 1'000'000));
  }
}

void receive_all(std::vector<Channel>& channels, std::uint64_t bytes) {
  std::vector<pollfd> polls;
  for (const Channel& channel : channels) polls.push_back({channel.driver.get(), POLLIN, 0});
  Bytes buffer(kWindow);
  for (std::size_t open = channels.size(); open > 0;) {
    if (::poll(polls.data(), polls.size(), -1) < 0) check_signals();
    for (std::size_t n = 0; n < polls.size(); ++n) {
      if (polls[n].revents == 0) continue;
      Channel& channel = channels[n];
      const std::size_t size = read_some(channel.driver.get(), buffer.data(), buffer.size());
      if (size == 0 || !is_pattern(channel.got, buffer.data(), size))
        throw BenchError("channel " + std::to_string(n) + ": wrong after byte " +
                         std::to_string(channel.got));
      channel.got += size;
      if (channel.got < bytes) continue;
      polls[n].fd = -1;
      --open;
    }
  }
}

}  // namespace

int channels_command(const Arguments& arguments) {
  CommandLine line(
      "Many TCP channels in one recording daemon, the devices sending at a steady rate; bytes and tapes are "
      "checked.\n"
      "Usage: linebench channels --daemon porttaped [--channels 64] [--rate 1000000] [--seconds 10]\n");
  line.option()("daemon", po::value<std::string>()->required(), "the program")(
      "channels", po::value<std::size_t>()->default_value(64), "how many")(
      "rate", po::value<std::size_t>()->default_value(1'000'000), "bytes a second and channel, at most 6 MB")(
      "seconds", po::value<std::size_t>()->default_value(10), "how long");
  if (!line.parse(arguments)) return 0;
  const std::size_t a_tick = line.get<std::size_t>("rate") * kTickMs / 1000;
  if (a_tick == 0 || a_tick > kWindow) throw UsageError("--rate is out of range");
  const std::uint64_t bytes = a_tick * (1000 / kTickMs) * line.get<std::size_t>("seconds");
  const ScratchDir dir;
  std::vector<Channel> channels(line.get<std::size_t>("channels"));
  for (Channel& channel : channels) {
    channel.listener = listen_tcp();
    channel.driver_port = free_tcp_port();
  }
  write_config(channels, dir.path());
  Child daemon = Child::run(
      {line.get<std::string>("daemon"), "run", (dir.path() / "config").string(), "--log-level", "warn"},
      (dir.path() / "output").string());
  const Watchdog watchdog(static_cast<unsigned>(60 + 4 * line.get<std::size_t>("seconds")), "channels");
  for (Channel& channel : channels) {
    channel.driver = connect_tcp(channel.driver_port, kStartMs);
    channel.device = accept_tcp(channel.listener.get());
  }
  const std::int64_t cpu_before = cpu_ns(daemon.pid());
  const std::int64_t start = now_ns();
  Child drivers = Child::fork([&] { receive_all(channels, bytes); });
  Child devices = Child::fork([&] { send_all(channels, bytes, a_tick); });
  if (drivers.wait() != 0 || devices.wait() != 0) throw BenchError("a channel failed");
  const double seconds = static_cast<double>(now_ns() - start) / 1e9;
  const std::int64_t cpu = cpu_ns(daemon.pid()) - cpu_before;
  const std::uint64_t peak = peak_rss_kib(daemon.pid());
  stop_daemon(daemon, dir.path() / "output");
  for (std::size_t n = 0; n < channels.size(); ++n)
    check_pattern_file((dir.path() / ("c" + std::to_string(n) + ".logr")).string(), 0, bytes);
  const double megabytes = static_cast<double>(bytes * channels.size()) / 1e6;
  JsonLine()
      .add("channels", std::uint64_t{channels.size()})
      .add("bytes", bytes)
      .add("seconds", seconds)
      .add("MBps", megabytes / seconds)
      .add("peak_kib", peak)
      .add("cpu_percent", static_cast<double>(cpu) / 1e7 / seconds)
      .print();
  return 0;
}

}  // namespace porttape::bench
