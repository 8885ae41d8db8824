#include "libport/faults/fault_keys.hpp"

#include <charconv>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <system_error>

#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 62U;
constexpr std::uint64_t kMostUnits = 1'000'000'000;
constexpr std::size_t kMostHex = 64;  // bytes

constexpr std::string_view kAll = "dcuysthr";
constexpr std::string_view kOfUnits = "duy";  // that may strike frames as well as bytes

bool read_number(std::string_view text, double most, double& number) {
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  return error == std::errc{} && stop == end && number >= 0 && number <= most;
}

bool read_count(std::string_view text, std::uint64_t least, std::uint64_t most, std::uint64_t& count) {
  const auto number = whole_number<std::uint64_t>(text);
  if (!number || *number < least || *number > most) return false;
  count = *number;
  return true;
}

bool read_seconds(std::string_view text, double most, Nanos& time) {
  double seconds = 0;
  if (!read_number(text, most, seconds)) return false;
  time = std::chrono::microseconds(std::llround(seconds * 1e6));
  return true;
}

bool read_hex(std::string_view text, Bytes& bytes) {
  if (text.empty() || text.size() % 2 != 0 || text.size() > 2 * kMostHex) return false;
  Bytes read;
  for (std::size_t at = 0; at < text.size(); at += 2) {
    const auto byte = whole_number<Byte>(text.substr(at, 2), 16);
    if (!byte) return false;
    read.push_back(*byte);
  }
  bytes = read;
  return true;
}

std::string seconds_text(Nanos time) {
  return fmt::format("{}", std::chrono::duration<double>(time).count());
}
std::string unless(std::uint64_t number, std::uint64_t usual) {
  return number == usual ? std::string() : std::to_string(number);
}
std::string if_when(const Fault& fault, Fault::When when, std::string text) {
  return fault.when == when ? std::move(text) : std::string();
}

bool read_chance(Fault& fault, std::string_view value) {
  fault.when = Fault::When::chance;
  return read_number(value, 1, fault.chance);
}
bool read_byte(Fault& fault, std::string_view value) {
  fault.when = Fault::When::byte;
  return read_count(value, 0, kMostBytes, fault.position);
}
bool read_frame(Fault& fault, std::string_view value) {
  fault.when = Fault::When::frame;
  return read_count(value, 1, kMostBytes, fault.position);
}
bool read_time(Fault& fault, std::string_view value) {
  fault.when = Fault::When::time;
  return read_seconds(value, 1e9, fault.at);
}
bool read_dir(Fault& fault, std::string_view value) {
  fault.dir.reset();
  if (value == "r") fault.dir = LineDir::r;
  if (value == "w") fault.dir = LineDir::w;
  return fault.dir || value == "both";
}
// What breaks the line by the clock does so to both directions.
std::string dir_text(const Fault& fault) {
  const bool breaks = fault.kind == Fault::Kind::hangup || fault.kind == Fault::Kind::replug;
  if (breaks && fault.when == Fault::When::time) return {};
  return fault.dir ? std::string(to_string(*fault.dir)) : "both";
}
bool read_unit(Fault& fault, std::string_view value) {
  fault.unit = value == "frame" ? Fault::Unit::frame : Fault::Unit::byte;
  return value == "frame" || value == "byte";
}
std::string unit_text(const Fault& fault) {
  if (fault.unit == Fault::Unit::automatic) return {};
  return fault.unit == Fault::Unit::frame ? "frame" : "byte";
}
bool read_change(Fault& fault, std::string_view value) {
  if (!read_hex(value, fault.change)) return false;
  for (const Byte byte : fault.change) {
    if (byte == 0) return false;
  }
  return true;
}
bool read_length(Fault& fault, std::string_view value) {
  return read_seconds(value, 86'400, fault.length) && fault.length > Nanos{0};
}
bool read_keep(Fault& fault, std::string_view value) {
  std::uint64_t keep = 0;
  if (!read_count(value, 0, kMostUnits, keep)) return false;
  fault.keep = keep;
  return true;
}

constexpr std::array kKeys{
    FaultKey{"p", kAll, "a probability, 0 to 1", read_chance,
             [](const Fault& fault) {
               return if_when(fault, Fault::When::chance, fmt::format("{}", fault.chance));
             }},
    FaultKey{
        "byte", kAll, "the offset of a byte, 0 or more", read_byte,
        [](const Fault& fault) { return if_when(fault, Fault::When::byte, std::to_string(fault.position)); }},
    FaultKey{"frame", kAll, "the number of a frame, 1 or more", read_frame,
             [](const Fault& fault) {
               return if_when(fault, Fault::When::frame, std::to_string(fault.position));
             }},
    FaultKey{"at", kAll, "seconds, 0 to 1000000000", read_time,
             [](const Fault& fault) { return if_when(fault, Fault::When::time, seconds_text(fault.at)); }},
    FaultKey{"dir", kAll, "r, w, both", read_dir, dir_text},
    FaultKey{"per", kOfUnits, "byte, frame", read_unit, unit_text},
    FaultKey{"end", kAll, "1 to 64 bytes in hex, two digits each",
             [](Fault& fault, std::string_view value) { return read_hex(value, fault.frame_end); },
             [](const Fault& fault) {
               const bool usual = fault.frame_size > 0 || fault.frame_end == Bytes{'\n'};
               return usual ? std::string() : to_hex(fault.frame_end);
             }},
    FaultKey{"size", kAll, "the bytes of a frame, 1 or more",
             [](Fault& fault, std::string_view value) {
               return read_count(value, 1, kMostUnits, fault.frame_size);
             },
             [](const Fault& fault) { return unless(fault.frame_size, 0); }},
    FaultKey{
        "burst", "dcuy", "a whole number, 1 to 1000000000",
        [](Fault& fault, std::string_view value) { return read_count(value, 1, kMostUnits, fault.burst); },
        [](const Fault& fault) { return unless(fault.burst, 1); }},
    FaultKey{
        "times", kAll, "a whole number, 1 to 1000000000",
        [](Fault& fault, std::string_view value) { return read_count(value, 1, kMostUnits, fault.times); },
        [](const Fault& fault) { return unless(fault.times, 0); }},
    FaultKey{"for", "ysr", "seconds, more than 0, up to 86400", read_length,
             [](const Fault& fault) { return seconds_text(fault.length); }},
    FaultKey{"keep", "t", "a number of bytes, 0 or more", read_keep,
             [](const Fault& fault) { return fault.keep ? std::to_string(*fault.keep) : std::string(); }},
    FaultKey{"xor", "c", "1 to 64 bytes in hex, two digits each, none 00", read_change,
             [](const Fault& fault) { return to_hex(fault.change); }},
};

}  // namespace

std::span<const FaultKey> fault_keys() { return kKeys; }

}  // namespace porttape
