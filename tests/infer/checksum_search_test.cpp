#include "libport/infer/checksum_search.hpp"

#include <fmt/format.h>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/infer/sessions.hpp"

namespace porttape {
namespace {

// "CRC-16/MODBUS from 0 to -2 at -2 little": what is found in the writes of a session that are longer than
// two bytes.
std::string found(const test::MemoryTape& tape) {
  std::vector<ByteView> frames;
  for (const auto& entry : tape.entries())
    if (entry.kind == RecordKind::write && entry.data.size() > 2) frames.push_back(as_bytes(entry.data));
  const auto field = find_checksum_field(frames);
  if (!field) return "none";
  return fmt::format("{} from {} to {} at {}{}{}", field->kind, field->from, field->to.value_or(field->at),
                     field->at, field->order == ByteOrder::little ? " little" : "", field->hex ? " hex" : "");
}

TEST(ChecksumSearch, KindSpanAndCodeAreFoundWhateverTheSeed) {
  for (std::uint32_t seed = 1; seed <= 6; ++seed) {
    EXPECT_EQ(found(test::modbus_rtu_session({.seed = seed})), "CRC-16/MODBUS from 0 to -2 at -2 little");
    EXPECT_EQ(found(test::nmea_session({.seed = seed})), "XOR from 1 to -5 at -4 hex");
    EXPECT_EQ(found(test::ubx_session({.seed = seed})), "FLETCHER-UBX from 2 to -2 at -2");
    EXPECT_EQ(found(test::gdb_session({.seed = seed})), "SUM-8 from 1 to -3 at -2 hex");
    EXPECT_EQ(found(test::scip_session({.seed = seed})), "none");
    EXPECT_EQ(found(test::modbus_tcp_session({.seed = seed})), "none");
  }
}

TEST(ChecksumSearch, AWrongSumOrTooFewFramesAreNone) {
  const std::string good = "\x01\x02\x03";
  const std::string other = "\x05\x06\x0b";
  const std::vector<ByteView> few{as_bytes(good), as_bytes(other)};
  EXPECT_EQ(find_checksum_field(few), std::nullopt);
  EXPECT_EQ(find_checksum_field({}), std::nullopt);
}

}  // namespace
}  // namespace porttape
