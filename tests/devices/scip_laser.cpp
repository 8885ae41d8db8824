// A laser driver on porttape's blocking ports: `scip_laser PORT COMMAND...`. PORT says where the scanner is:
// on a tty (serial:/dev/ttyACM0,timeout=1), on the network, or on a tape in this process
// (type=logreader,file=laser.log,timing=reactive,strictness=1,timeout=1). Exit status 1 when anything is
// wrong.

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "libport/blocking/blocking_port.hpp"
#include "tests/devices/scip_answer.hpp"

namespace {

using porttape::BlockingPort;

// The value, or the failure as an exception that main() tells.
template <class T>
T need(porttape::Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  if constexpr (!std::is_void_v<T>) return std::move(*result);
}

std::vector<std::string> read_answer(BlockingPort& port) {
  std::vector<std::string> lines;
  for (std::string line;;) {
    if (!need(port.read_line(line)).done()) throw std::runtime_error("no answer");
    line.pop_back();
    if (line.empty()) return lines;
    lines.push_back(line);
  }
}

void ask(BlockingPort& port, const std::string& command) {
  need(port.flush());
  need(port.write_string(command + '\n'));
  for (unsigned left = scip::answers_to(command); left > 0; --left) {
    const scip::Answer answer = scip::parse(command, read_answer(port));
    std::fputs(scip::describe(command, answer).c_str(), stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fputs("usage: scip_laser PORT COMMAND...\n", stderr);
    return 2;
  }
  try {
    const std::unique_ptr<BlockingPort> port = need(BlockingPort::create(argv[1]));
    need(port->open());
    for (int i = 2; i < argc; ++i) ask(*port, argv[i]);
    port->close();
    return port->finish();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "scip_laser: %s\n", error.what());
    return 1;
  }
}
