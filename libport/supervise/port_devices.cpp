#include "libport/supervise/port_devices.hpp"

#include <algorithm>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <sys/sysmacros.h>

#include "libport/base/tty_device.hpp"

namespace porttape {
namespace {

constexpr unsigned kTtyMajor = 4;  // consoles below kFirstSerial
constexpr unsigned kFirstSerial = 64;

// By proc_pid_stat(5): the fifth number behind the name, which may hold anything.
std::optional<std::uint64_t> controlling_terminal() {
  std::ifstream file("/proc/self/stat");
  std::string text;
  std::getline(file, text);
  const std::size_t name_end = text.rfind(')');
  if (name_end == std::string::npos) return std::nullopt;
  std::istringstream rest(text.substr(name_end + 1));
  char state = 0;
  int parent = 0;
  int group = 0;
  int session = 0;
  std::uint32_t terminal = 0;
  if (!(rest >> state >> parent >> group >> session >> terminal) || terminal == 0) return std::nullopt;
  return device_number(terminal);
}

}  // namespace

PortDevices::PortDevices() {
  for (int fd = 0; fd <= 2; ++fd) {
    struct stat status {};
    if (::fstat(fd, &status) == 0 && S_ISCHR(status.st_mode)) terminals_.push_back(status.st_rdev);
  }
  if (const std::optional<std::uint64_t> terminal = controlling_terminal()) terminals_.push_back(*terminal);
}

// Null, /dev/tty and consoles are character devices as well.
bool PortDevices::can_be(std::uint64_t device) const {
  const unsigned kind = major(device);
  if (kind == 1 || kind == 5 || (kind == kTtyMajor && minor(device) < kFirstSerial)) return false;
  return std::ranges::find(terminals_, device) == terminals_.end();
}

std::uint64_t device_number(std::uint32_t word) {
  return makedev((word >> 8U) & 0xfffU, (word & 0xffU) | ((word >> 12U) & 0xfff00U));
}

bool is_serial(std::uint64_t device, const std::string& drivers) {
  std::ifstream file(drivers);
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string name;
    std::string path;
    unsigned kind = 0;
    unsigned first = 0;
    char dash = 0;
    std::string what;
    if (!(words >> name >> path >> kind >> first)) continue;
    unsigned last = first;
    if (words.peek() == '-') words >> dash >> last;
    if (words >> what && what == "serial" && kind == major(device) && first <= minor(device) &&
        minor(device) <= last)
      return true;
  }
  return false;
}

}  // namespace porttape
