#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/infer/session_tape.hpp"
#include "tests/support/memory_tape.hpp"

// Sessions of drivers as they would be recorded, written down by the protocols' descriptions: with checksums
// of their own and nothing of the library.
namespace porttape::test {

// What differs between the sessions of one driver.
struct SessionShape {
  std::uint32_t seed =
      1;  // values, times, names; with it how often something is asked, where `polls` is free
  bool free_polls = false;  // polls and keep-alives come as often as the seed says
  bool answers = true;      // the device's
};

MemoryTape modbus_rtu_session(const SessionShape& shape);
MemoryTape modbus_tcp_session(const SessionShape& shape);
MemoryTape nmea_session(const SessionShape& shape);
MemoryTape ubx_session(const SessionShape& shape);
MemoryTape scip_session(const SessionShape& shape);
MemoryTape mavlink1_session(const SessionShape& shape);
MemoryTape mavlink2_session(const SessionShape& shape);
MemoryTape gdb_session(const SessionShape& shape);

struct SessionKind {
  std::string_view name;
  MemoryTape (*make)(const SessionShape& shape);
};
const std::vector<SessionKind>& session_kinds();

// As the library reads it.
inline SessionTape session(const MemoryTape& tape, std::string name = "tape") {
  MemorySource source(tape);
  return read_session(source, std::move(name), 1 << 20).value();
}

}  // namespace porttape::test
