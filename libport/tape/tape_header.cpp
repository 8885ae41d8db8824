#include "libport/tape/tape_header.hpp"

#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <fcntl.h>
#include <random>
#include <sys/random.h>
#include <unistd.h>

#include "libport/base/bytes.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/version.hpp"

namespace porttape {
namespace {

using WallTime = std::chrono::time_point<std::chrono::system_clock, std::chrono::microseconds>;

WallTime wall_now() {
  return std::chrono::floor<std::chrono::microseconds>(std::chrono::system_clock::now());
}

std::string rfc3339(WallTime time) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(time);
  const std::time_t whole = seconds.time_since_epoch().count();
  std::tm utc{};
  ::gmtime_r(&whole, &utc);
  std::array<char, 32> date{};
  std::strftime(date.data(), date.size(), "%FT%T", &utc);
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%s.%06dZ", date.data(),
                static_cast<int>((time - seconds).count()));
  return text.data();
}

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

std::string boot_id() {
  const UniqueFd file(::open("/proc/sys/kernel/random/boot_id", O_RDONLY | O_CLOEXEC));
  if (!file) return {};
  std::array<char, 64> text{};
  const ssize_t size = ::read(file.get(), text.data(), text.size());
  std::string id(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  return id.substr(0, id.find('\n'));
}

std::string random_id() {
  std::array<Byte, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), GRND_NONBLOCK) != static_cast<ssize_t>(bytes.size())) {
    std::random_device device;
    for (Byte& byte : bytes) byte = static_cast<Byte>(device());
  }
  return to_hex(bytes);
}

}  // namespace

TapeZero tape_zero(Instant zero, Instant now) {
  const auto ago = std::chrono::duration_cast<Micros>(now - zero);
  const auto since_boot = std::chrono::duration_cast<Micros>(zero.time_since_epoch());
  return {rfc3339(wall_now() - ago), since_boot.count(), boot_id()};
}

TapeHeader completed(TapeHeader header) {
  if (header.created.empty()) header.created = rfc3339(wall_now());
  if (header.host.empty()) header.host = host_name();
  if (header.tool.empty()) header.tool = "porttape " + std::string(version());
  if (header.id.empty()) header.id = random_id();
  return header;
}

}  // namespace porttape
