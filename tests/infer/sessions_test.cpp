// That the sessions which the tests are made with are what their protocols say, by known examples.

#include "tests/infer/sessions.hpp"

#include <gtest/gtest.h>

namespace porttape::test {
namespace {

std::string first_write(const MemoryTape& tape, std::string_view part) {
  for (const auto& entry : tape.entries())
    if (entry.kind == RecordKind::write && entry.data.find(part) != std::string::npos) return entry.data;
  return "none";
}

TEST(Sessions, ChecksumsAreTheProtocols) {
  EXPECT_EQ(first_write(nmea_session({}), "PMTK220"), "$PMTK220,200*2C\r\n");
  EXPECT_EQ(first_write(gdb_session({}), "?"), "$?#3f");
  EXPECT_EQ(first_write(ubx_session({}), std::string("\x0a\x04")),
            std::string("\xb5\x62\x0a\x04\0\0\x0e\x34", 8));
  EXPECT_EQ(first_write(modbus_rtu_session({}), std::string("\x11\x03")),
            std::string("\x11\x03\0\0\0\x0a\xc7\x5d", 8));
}

TEST(Sessions, OneSeedIsOneSessionAndAnotherDiffers) {
  for (const SessionKind& kind : session_kinds()) {
    const auto writes = [&](std::uint32_t seed) { return kind.make({.seed = seed}).all(RecordKind::write); };
    EXPECT_EQ(writes(1), writes(1)) << kind.name;
    EXPECT_NE(writes(1), writes(2)) << kind.name;
  }
}

}  // namespace
}  // namespace porttape::test
