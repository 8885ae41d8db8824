// Reads all of a tape through the installed library: `porttape_program FILE` prints what the device sent.

#include <cstdio>
#include <libport/blocking/blocking_port.hpp>
#include <string>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const auto port =
      porttape::BlockingPort::create({{"type", "logreader"}, {"file", argv[1]}, {"rate", "1000"}});
  if (!port || !(*port)->open()) return 1;
  std::string text;
  while (true) {
    const auto come = (*port)->read_string(text);
    if (!come) return 1;
    if (!come->done()) return 0;
    std::fwrite(text.data(), 1, text.size(), stdout);
  }
}
