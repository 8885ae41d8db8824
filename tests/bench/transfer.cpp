#include "tests/bench/transfer.hpp"

#include <algorithm>
#include <string>

#include "tests/bench/commands.hpp"
#include "tests/bench/pattern.hpp"
#include "tests/bench/rig.hpp"

namespace porttape::bench {
namespace po = boost::program_options;

void flood(int fd, std::uint64_t offset, std::uint64_t size, std::size_t write_size) {
  for (std::uint64_t sent = 0; sent < size;) {
    const auto piece = static_cast<std::size_t>(std::min<std::uint64_t>(size - sent, write_size));
    write_all(fd, pattern_at(offset + sent), piece);
    sent += piece;
  }
}

void sink(int fd, std::uint64_t offset, std::uint64_t size) {
  Bytes buffer(kWindow);
  for (std::uint64_t got = 0; got < size;) {
    const auto most = static_cast<std::size_t>(std::min<std::uint64_t>(size - got, buffer.size()));
    const std::size_t n = read_some(fd, buffer.data(), most);
    if (n == 0) throw BenchError("the line hung up after " + std::to_string(got) + " bytes");
    if (!is_pattern(offset + got, buffer.data(), n)) {
      throw BenchError("wrong bytes in the " + std::to_string(n) + " after byte " + std::to_string(got));
    }
    got += n;
  }
}

int flood_command(const Arguments& arguments) {
  CommandLine line(
      "Sends the test pattern, as fast as the port takes it.\n"
      "Usage: linebench flood PORT --bytes N [--write 4096]\n",
      "port");
  line.option()("port", po::value<std::string>()->required(), "where to")(
      "bytes", po::value<std::uint64_t>()->required(), "how many")(
      "write", po::value<std::size_t>()->default_value(4096), "bytes a write, at most 65536");
  if (!line.parse(arguments)) return 0;
  const UniqueFd port = open_port(line.get<std::string>("port"));
  flood(port.get(), 0, line.get<std::uint64_t>("bytes"),
        std::clamp<std::size_t>(line.get<std::size_t>("write"), 1, kWindow));
  return 0;
}

int sink_command(const Arguments& arguments) {
  CommandLine line(
      "Reads the test pattern and checks it, from a port or from a relay it starts (a replay of make-tape's "
      "tape).\n"
      "Usage: linebench sink PORT --bytes N\n"
      "       linebench sink --relay 'replay=porttaped replay --tape T --driver pty:{driver} --timing none' "
      "--bytes N\n",
      "port");
  line.option()("port", po::value<std::string>(), "where from")("relay", po::value<std::string>(),
                                                                "NAME=COMMAND to start and read from")(
      "bytes", po::value<std::uint64_t>()->required(), "how many")(
      "timeout", po::value<unsigned>()->default_value(600), "seconds");
  if (!line.parse(arguments)) return 0;
  if (line.has("port") == line.has("relay")) throw UsageError("give a PORT or --relay");
  const auto bytes = line.get<std::uint64_t>("bytes");
  const Watchdog watchdog(line.get<unsigned>("timeout"), "the pattern");
  JsonLine result;
  std::int64_t start = 0;
  if (line.has("relay")) {
    Rig rig(parse_relay(line.get<std::string>("relay")));
    rig.start();
    start = now_ns();
    rig.open_driver();
    sink(rig.driver(), 0, bytes);
    if (rig.has_process()) {
      result.add("relay_peak_kib", peak_rss_kib(rig.pid()));
      result.add("relay_cpu_s", static_cast<double>(rig.relay_cpu_ns()) / 1e9);
    }
  } else {
    const UniqueFd port = open_port(line.get<std::string>("port"));
    start = now_ns();
    sink(port.get(), 0, bytes);
  }
  const double seconds = static_cast<double>(now_ns() - start) / 1e9;
  result.add("bytes", bytes).add("seconds", seconds).add("MBps", static_cast<double>(bytes) / 1e6 / seconds);
  result.print();
  return 0;
}

}  // namespace porttape::bench
