#include "libport/base/checksum.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

TEST(ChecksumTest, EachKindGivesItsCheckValue) {
  for (const ChecksumKind& kind : checksum_kinds()) {
    EXPECT_EQ(checksum_of(kind, as_bytes("123456789")), kind.check) << kind.name;
  }
}

TEST(ChecksumTest, NamesAreFoundInAnyCaseAndByTheirAliases) {
  EXPECT_EQ(find_checksum("crc-16/modbus")->name, "CRC-16/MODBUS");
  EXPECT_EQ(find_checksum("CRC-32C")->name, "CRC-32/ISCSI");
  EXPECT_EQ(find_checksum("lrc")->name, "LRC");
  EXPECT_EQ(find_checksum("CRC-17"), nullptr);
  for (const ChecksumKind& kind : checksum_kinds()) EXPECT_EQ(find_checksum(kind.name), &kind);
}

TEST(ChecksumTest, OfNothingIsNoTrouble) {
  for (const ChecksumKind& kind : checksum_kinds()) (void)checksum_of(kind, {});
}

}  // namespace
}  // namespace porttape
