#include "libport/rules/checksum.hpp"

#include <string>

#include <gtest/gtest.h>

#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

using namespace std::string_literals;

// Frames as devices send them.
bool holds(std::string_view protocol, std::string_view frame) {
  for (const FrameFormat& format : protocol_formats(protocol)) {
    const FrameCut cut = cut_frame(format, as_bytes(frame), true);
    if (cut.state != FrameCut::State::frame || cut.size != frame.size()) continue;
    return FrameChecksum(*format.checksum, *find_checksum(format.checksum->kind)).holds(as_bytes(frame));
  }
  ADD_FAILURE() << "no frame of " << protocol;
  return false;
}

TEST(FrameChecksumTest, ProtocolsByName) {
  EXPECT_TRUE(holds("nmea", "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n"));
  EXPECT_FALSE(holds("nmea", "$GPGLL,5057.971,N,00146.110,E,142451,A*27\r\n"));
  EXPECT_TRUE(holds("nmea", "!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C\r\n"));
  EXPECT_TRUE(holds("ubx", "\xb5\x62\x0a\x04\x00\x00\x0e\x34"s));
  EXPECT_TRUE(holds("modbus-rtu", "\x01\x03\x00\x00\x00\x0a\xc5\xcd"s));
  EXPECT_TRUE(holds("modbus-ascii", ":010300000001FB\r\n"));
  EXPECT_TRUE(holds("gdb", "$qSupported#37"));
  EXPECT_TRUE(holds("scip", "00P\n"));
  EXPECT_FALSE(holds("scip", "00Q\n"));
  // HEARTBEAT of both versions; the second one's checksum is before its signature, where it has one.
  EXPECT_TRUE(holds("mavlink", "\xfe\x09\x4e\x01\x01\x00\x00\x00\x00\x00\x02\x03\x51\x04\x03\x1c\x7f"s));
}

TEST(FrameChecksumTest, ItsPlaceMayBeOutsideAShortFrame) {
  const FrameFormat format = protocol_formats("ubx").front();
  const FrameChecksum checksum(*format.checksum, *find_checksum("FLETCHER-UBX"));
  for (std::size_t size = 0; size < 4; ++size) {
    const Bytes frame(size, 0xb5);
    EXPECT_EQ(checksum.holds(frame), false);
    EXPECT_EQ(checksum.expected(frame).has_value(), checksum.place(frame).has_value());
  }
}

}  // namespace
}  // namespace porttape
