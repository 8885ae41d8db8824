#pragma once

#include <cstdint>
#include <string_view>

namespace porttape {

// A wire of a serial line beside the data, or the break on the data's own, goes on or off.
struct LineSignal {
  enum class Name : std::uint8_t { dtr, rts, cts, dsr, cd, ri, brk };
  Name name = Name::dtr;
  bool on = false;

  friend bool operator==(const LineSignal&, const LineSignal&) = default;
};

// Whether the driver's end of the line drives it; the device drives the others, and both may break.
constexpr bool is_output(LineSignal::Name name) {
  return name == LineSignal::Name::dtr || name == LineSignal::Name::rts;
}

// As tapes and reports have it: `dtr`; of a break `break`.
constexpr std::string_view name_of(LineSignal::Name name) {
  switch (name) {
    case LineSignal::Name::dtr:
      return "dtr";
    case LineSignal::Name::rts:
      return "rts";
    case LineSignal::Name::cts:
      return "cts";
    case LineSignal::Name::dsr:
      return "dsr";
    case LineSignal::Name::cd:
      return "cd";
    case LineSignal::Name::ri:
      return "ri";
    case LineSignal::Name::brk:
      return "break";
  }
  return {};
}

}  // namespace porttape
