#include "tests/simulation/line_check.hpp"

#include <algorithm>
#include <charconv>

namespace porttape::simulation {
namespace {

// Whether each datagram that was written is one that came.
bool are_whole(std::span<const Passed> came, std::span<const Passed> written) {
  auto at = came.begin();
  for (const Passed& each : written) {
    if (each.what != Passed::What::data || each.to_listener) continue;
    at = std::find_if(at, came.end(), [&each](const Passed& other) {
      return other.what == Passed::What::data && other.to_listener && other.data == each.data;
    });
    if (at == came.end()) return false;
    ++at;
  }
  return true;
}

}  // namespace

bool is_subsequence(ByteView part, ByteView whole) {
  auto at = whole.begin();
  for (const Byte byte : part) {
    at = std::find(at, whole.end(), byte);
    if (at == whole.end()) return false;
    ++at;
  }
  return true;
}

Bytes joined(std::span<const Passed> passed, bool to_listener) {
  Bytes all;
  for (const Passed& each : passed) {
    if (each.what == Passed::What::data && each.to_listener == to_listener)
      all.insert(all.end(), each.data.begin(), each.data.end());
  }
  return all;
}

void check_passes(World& world, const Line& from, const Line& to, bool whole) {
  if (whole && from.kind().datagrams && to.kind().datagrams && !are_whole(from.passed, to.passed))
    world.wrong("{} was given a datagram that {} did not give, or in another order", to.name(), from.name());
  if (!is_subsequence(joined(to.passed, false), joined(from.passed, true)))
    world.wrong("what {} was given is not what {} gave, in order", to.name(), from.name());
}

std::uint64_t lost_between(const Line& driver, const Line& device) {
  return driver.bytes_in - device.bytes_out + device.bytes_in - driver.bytes_out + driver.bytes_dropped +
         device.bytes_dropped + driver.bytes_unread;
}

std::uint64_t told_by(const World& world, const std::string& who,
                      std::initializer_list<std::string_view> texts) {
  std::uint64_t sum = 0;
  for (const std::string& line : world.logged()) {
    if (!line.starts_with(who + ": ")) continue;
    for (const std::string_view text : texts) {
      const std::size_t end = line.find(text);
      if (end == std::string::npos || end == 0) continue;
      const std::size_t begin = line.find_last_not_of("0123456789", end - 2) + 1;
      std::uint64_t bytes = 0;
      std::from_chars(line.data() + begin, line.data() + end, bytes);
      sum += bytes;
    }
  }
  return sum;
}

}  // namespace porttape::simulation
