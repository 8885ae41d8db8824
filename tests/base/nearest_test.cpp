#include "libport/base/nearest.hpp"

#include <array>
#include <string>

#include <gtest/gtest.h>

namespace porttape {
namespace {

constexpr std::array<std::string_view, 9> kWords = {"record", "replay", "run",  "bridge",    "baud",
                                                    "tcp",    "udp",    "unix", "strictness"};

std::string nearest_to(std::string_view word) { return std::string(nearest(word, kWords).value_or("none")); }

TEST(Nearest, OneSlipInAShortWordMoreInALongOne) {
  EXPECT_EQ(nearest_to("recrod"), "record");
  EXPECT_EQ(nearest_to("repaly"), "replay");
  EXPECT_EQ(nearest_to("bridg"), "bridge");
  EXPECT_EQ(nearest_to("bauds"), "baud");
  EXPECT_EQ(nearest_to("tpc"), "tcp");
  EXPECT_EQ(nearest_to("striktnes"), "strictness");
  EXPECT_EQ(nearest_to("tp"), "tcp");
}

TEST(Nearest, CaseDoesNotMatter) {
  EXPECT_EQ(nearest_to("TCP"), "tcp");
  EXPECT_EQ(nearest_to("Recrod"), "record");
}

TEST(Nearest, TheOnlyWordThatBeginsSo) {
  EXPECT_EQ(nearest_to("strict"), "strictness");
  EXPECT_EQ(nearest_to("bri"), "bridge");
  EXPECT_EQ(nearest_to("re"), "none");
}

TEST(Nearest, NothingThatIsFar) {
  for (const char* word : {"", "x", "modem", "colour", "ptys", "/dev/ttyUSB0"})
    EXPECT_EQ(nearest_to(word), "none") << word;
  EXPECT_EQ(nearest_to(std::string(100'000, 'r')), "none");
}

TEST(Nearest, OfTwoEquallyNearTheFirst) {
  constexpr std::array<std::string_view, 2> words = {"dtr", "rts"};
  EXPECT_EQ(nearest("dts", words), "dtr");
}

TEST(Nearest, AMessageEndsWithTheQuestion) {
  EXPECT_EQ(did_you_mean("recrod", kWords), "; did you mean 'record'?");
  EXPECT_EQ(did_you_mean("modem", kWords), "");
}

}  // namespace
}  // namespace porttape
