#include "libport/tape/layout.hpp"

#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;
using testing::HasSubstr;

std::string detect(const Bytes& read, const Bytes& write) {
  MemorySource r("t.logr", read);
  MemorySource w("t.logw", write);
  const auto layout = detect_layout(&r, &w);
  return layout ? std::string(to_string(*layout)) : layout.error().message;
}

TEST(Layout, NothingAtAllIsBigEndian) {
  EXPECT_EQ(*detect_layout(nullptr, nullptr), Layout::big_endian);
  EXPECT_EQ(detect({}, {}), "big-endian");
}

TEST(Layout, IsFoundFromOneBlockInEitherFile) {
  for (const std::int64_t us : {0L, 1L, 26L, 256L, 999'999L, 1'000'000L, 3'600'000'000L}) {
    for (const std::size_t length : {1U, 2U, 10U, 255U, 256U, 65'536U}) {
      for (const char fill : {'\0', '\x01', 'a', '\xff'}) {
        const std::vector<Block> blocks{{us, std::string(length, fill)}};
        EXPECT_EQ(detect(test::block_bytes(blocks), {}), "big-endian") << us << ' ' << length;
        EXPECT_EQ(detect({}, test::block_bytes(blocks)), "big-endian") << us << ' ' << length;
        EXPECT_EQ(detect(test::block_bytes(blocks, true), {}), "native 64-bit") << us << ' ' << length;
        EXPECT_EQ(detect({}, test::block_bytes(blocks, true)), "native 64-bit") << us << ' ' << length;
      }
    }
  }
}

TEST(Layout, IsFoundFromATornFirstBlockOnceItsHeaderIsWhole) {
  for (const std::int64_t us : {0L, 26L, 1'000'000L}) {
    const std::vector<Block> blocks{{us, "some data"}};
    const Bytes big = test::block_bytes(blocks);
    for (std::ptrdiff_t size = 1; size < std::ssize(big); ++size) {
      EXPECT_EQ(detect(Bytes(big.begin(), big.begin() + size), {}), "big-endian") << us << ' ' << size;
    }
    const Bytes native = test::block_bytes(blocks, true);
    for (std::ptrdiff_t size = 24; size < std::ssize(native); ++size) {
      EXPECT_EQ(detect(Bytes(native.begin(), native.begin() + size), {}), "native 64-bit")
          << us << ' ' << size;
    }
  }
}

TEST(Layout, OneFileDecidesWhereTheOtherIsTornInItsFirstHeader) {
  for (const bool native64 : {false, true}) {
    const Bytes whole = test::block_bytes({{1'700'000'000'000'026, "VV"}}, native64);
    for (std::ptrdiff_t size = 1; size <= std::ssize(whole); ++size) {
      const Bytes torn(whole.begin(), whole.begin() + size);
      EXPECT_EQ(detect(whole, torn), native64 ? "native 64-bit" : "big-endian") << size;
      EXPECT_EQ(detect(torn, whole), native64 ? "native 64-bit" : "big-endian") << size;
    }
  }
}

TEST(Layout, ANativeTapeWithADeceptiveFirstTime) {
  for (const std::int64_t us : {0, 1, 2, 256, 65'536}) {
    const Bytes whole = test::block_bytes({{us, "abcdefghij"}, {us + 1, "x"}}, true);
    for (std::ptrdiff_t size = 24; size <= std::ssize(whole); ++size) {
      EXPECT_EQ(detect(Bytes(whole.begin(), whole.begin() + size), {}), "native 64-bit") << us << ' ' << size;
    }
  }
}

TEST(Layout, DamageFurtherOnDoesNotHideTheLayout) {
  for (const bool native64 : {false, true}) {
    Bytes bytes = test::block_bytes({{1, "abc"}, {2, "def"}, {3, "ghi"}}, native64);
    bytes[native64 ? 27 + 11 : 15 + 5] = 0x7F;  // microseconds of the second block
    EXPECT_EQ(detect(bytes, {}), native64 ? "native 64-bit" : "big-endian");
  }
}

TEST(Layout, AWrongLengthInTheFirstBlockDoesNotHideTheLayout) {
  Bytes bytes = test::block_bytes({{1, "abc"}, {2, "def"}, {3, "ghi"}});
  bytes[8] = 0xF0;
  EXPECT_EQ(detect(bytes, {}), "big-endian");
}

TEST(Layout, FilesOfDifferentLayoutsAreNoPair) {
  const std::vector<Block> blocks{{26, "VV"}, {30, "\n"}};
  EXPECT_THAT(detect(test::block_bytes(blocks), test::block_bytes(blocks, true)),
              HasSubstr("different layouts"));
  // Its first header, read big-endian, has a length that a torn block may have.
  const std::vector<Block> plausible{{0x010000, "VV"}, {0x010001, "\n"}};
  EXPECT_THAT(detect(test::block_bytes(plausible, true), test::block_bytes(blocks)),
              HasSubstr("different layouts"));
}

TEST(Layout, OtherFilesAreNotATape) {
  const std::vector<std::string> others{"root:x:0:0:root:/root:/bin/bash\n",
                                        "ab",
                                        "hello\n",
                                        std::string("\x7f"
                                                    "ELF\x02\x01\x01\0\0\0\0\0\0\0\0\0\x03\0>",
                                                    19),
                                        "\x89PNG\r\n\x1a\n",
                                        std::string("\xca\xfe\xba\xbe\0\0\0\x34\0\x1d\x0a\0\0\0", 14),
                                        "{\"format\":1}"};
  for (const std::string& other : others) {
    EXPECT_THAT(detect(test::bytes_of(other), {}), HasSubstr("t.logr is not a file of a tape")) << other;
    EXPECT_THAT(detect({}, test::bytes_of(other)), HasSubstr("t.logw is not a file of a tape")) << other;
  }
}

TEST(Layout, RandomBytesAreNotATape) {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    Bytes noise(5000);
    for (Byte& byte : noise) byte = static_cast<Byte>(random());
    noise[4] |= 0x80U;  // microseconds far too large in either layout
    noise[7] |= 0x80U;
    EXPECT_THAT(detect(noise, {}), HasSubstr("not a file of a tape"));
  }
}

// A first block that is not whole is all there is to go by.
TEST(Layout, TheOnlyBlockMayClaim64MebibytesAndATimeOf31Bits) {
  constexpr std::uint64_t kMost = std::uint64_t{64} << 20;
  constexpr std::uint64_t kLatest = (std::uint64_t{1} << 31) - 1;
  const auto detected = [](std::uint64_t seconds, std::uint64_t length) {
    Bytes torn = test::header_bytes(seconds, 26, length);
    test::append(torn, "abc");
    return detect(torn, {});
  };
  EXPECT_EQ(detected(1, kMost), "big-endian");
  EXPECT_EQ(detected(kLatest, 4), "big-endian");
  EXPECT_NE(detected(1, kMost + 1), "big-endian");
  EXPECT_NE(detected(kLatest + 1, 4), "big-endian");
}

}  // namespace
}  // namespace porttape
