// Sends back what comes, over any port: `port_echo PORT`, e.g. `port_echo pty:/tmp/echo` or
// `port_echo tcp-listen:127.0.0.1:7`. Ends when the line does.

#include <cstdio>
#include <memory>
#include <string>

#include "libport/blocking/blocking_port.hpp"

namespace {

int fail(const porttape::Error& error) {
  std::fprintf(stderr, "port_echo: %s\n", error.message.c_str());
  return porttape::exit_status_of(error.code);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: port_echo PORT\n", stderr);
    return 2;
  }
  auto made = porttape::BlockingPort::create(argv[1]);
  if (!made) return fail(made.error());
  porttape::BlockingPort& port = **made;
  if (const auto opened = port.open(); !opened) return fail(opened.error());
  for (std::string text;;) {
    const auto come = port.read_string(text);
    if (!come) return fail(come.error());
    if (come->end == porttape::Transfer::End::closed) return port.finish();
    if (!come->done()) continue;
    if (const auto sent = port.write_string(text); !sent) return fail(sent.error());
  }
}
