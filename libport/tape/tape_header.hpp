#pragma once

#include <string>

namespace porttape {

// What the header line of the events file says.
struct TapeHeader {
  std::string device;  // the port as the user named it
  std::string driver;
  std::string created{};  // RFC 3339; the writer fills in now where it is empty
  std::string host{};     // the writer fills in this machine's name where it is empty
  std::string tool{};     // the writer fills in "porttape VERSION" where it is empty

  friend bool operator==(const TapeHeader&, const TapeHeader&) = default;
};

}  // namespace porttape
