// Measures lines: ptys, relays, recorders and replays. Every subcommand prints JSON, an object a line.

#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>

#include "tests/bench/commands.hpp"
#include "tests/bench/line.hpp"

namespace porttape::bench {
namespace {

struct Command {
  const char* name;
  int (*run)(const Arguments&);
  const char* summary;
};

constexpr Command kCommands[] = {
    {"rtt", rtt_command, "round trips of a ping-pong through lines, side by side"},
    {"calls", calls_command, "what a driver's calls take under porttape exec, beside a bare pty"},
    {"drive", drive_command, "a driver that does what rtt or calls ask of it"},
    {"throughput", throughput_command, "bytes a second through lines, each way and both, checked"},
    {"arrivals", arrivals_command, "when a replay's blocks arrive, against the tape's times"},
    {"channels", channels_command, "many TCP channels in one recording daemon, checked"},
    {"ptys", ptys_command, "many channels of a serial device and a pty in one recording daemon, checked"},
    {"idle", idle_command, "CPU time and wake-ups of a relay that has nothing to do"},
    {"peak", peak_command, "time, CPU and peak memory of a program"},
    {"echo", echo_command, "a device that echoes"},
    {"flood", flood_command, "sends the test pattern"},
    {"sink", sink_command, "reads and checks the test pattern"},
    {"make-tape", make_tape_command, "writes a tape of the test pattern"},
    {"read", read_command, "reads files, as fast as it goes"},
};

void print_help() {
  std::puts("linebench COMMAND [options]: measures lines; prints JSON, an object a line.\n");
  for (const Command& command : kCommands) std::printf("  %-12s %s\n", command.name, command.summary);
  std::puts("\n`linebench COMMAND --help` tells more. Exit status: 0 done, 1 failed, 2 usage.");
}

int run(int argc, char** argv) {
  if (argc < 2 || std::strcmp(argv[1], "--help") == 0 || std::strcmp(argv[1], "-h") == 0) {
    print_help();
    return argc < 2 ? 2 : 0;
  }
  for (const Command& command : kCommands) {
    if (std::strcmp(argv[1], command.name) == 0) return command.run(Arguments(argv + 2, argv + argc));
  }
  throw UsageError("no command '" + std::string(argv[1]) + "'; see linebench --help");
}

}  // namespace
}  // namespace porttape::bench

int main(int argc, char** argv) {
  using namespace porttape::bench;
  try {
    install_signal_handlers();
    return run(argc, argv);
  } catch (const UsageError& error) {
    std::fprintf(stderr, "linebench: %s\n", error.what());
    return 2;
  } catch (const Interrupted& interrupted) {
    return 128 + interrupted.signal_number;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "linebench: %s\n", error.what());
    return 1;
  }
}
