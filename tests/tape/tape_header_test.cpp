#include "libport/tape/tape_header.hpp"

#include <array>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <limits>
#include <string>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/version.hpp"
#include "tests/support/manual_clock.hpp"

namespace porttape {
namespace {

using testing::MatchesRegex;

constexpr std::int64_t kFar = 10'000'000'000'000'000;  // 300 years, in microseconds

std::optional<Micros> apart_by_wall(const std::string& from, const std::string& to) {
  return since({from, 0, ""}, {to, 0, ""});
}

TEST(WallText, IsUtcWithMicroseconds) {
  EXPECT_EQ(wall_text(Micros(0)), "1970-01-01T00:00:00.000000Z");
  EXPECT_EQ(wall_text(Micros(-1)), "1969-12-31T23:59:59.999999Z");
  EXPECT_EQ(wall_text(Micros(1'709'164'799'000'010)), "2024-02-28T23:59:59.000010Z");
}

TEST(WallText, OfAMomentIsBeforeNowByTheSame) {
  ManualClock clock;
  const std::string now = wall_text(clock.now(), clock);
  clock.pass(std::chrono::milliseconds(1500));
  EXPECT_EQ(apart_by_wall(now, wall_text(clock.now(), clock)), Micros(1'500'000));
  EXPECT_EQ(wall_text(clock.now() - std::chrono::milliseconds(1500), clock), now);
}

TEST(TapeZeros, TellWhichBootItWasAsTheKernelDoes) {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string boot;
  std::getline(file, boot);
  const ManualClock clock;
  EXPECT_EQ(tape_zero(clock.now(), clock).boot, boot);
}

TEST(TapeZeros, BeyondThreeCenturiesAreNotTold) {
  const auto apart = [](std::int64_t from, std::int64_t to) { return since({"", from, "b"}, {"", to, "b"}); };
  EXPECT_EQ(apart(0, kFar), Micros(kFar));
  EXPECT_EQ(apart(0, kFar + 1), std::nullopt);
  EXPECT_EQ(apart(kFar, 0), Micros(-kFar));
  EXPECT_EQ(apart(kFar + 1, 0), std::nullopt);
  EXPECT_EQ(apart_by_wall("1700-01-01T00:00:00Z", "2000-01-01T00:00:00Z"), Micros(9'467'020'800'000'000));
  EXPECT_EQ(apart_by_wall("1600-01-01T00:00:00Z", "2000-01-01T00:00:00Z"), std::nullopt);
}

TEST(TapeZeros, OfDifferentBootsAreApartByTheWallClockWhereBothHaveOne) {
  const std::string wall = "2024-02-29T00:00:00Z";
  EXPECT_EQ(since({wall, 5, "one"}, {wall, 9, "two"}), Micros(0));
  EXPECT_EQ(since({wall, 5, "one"}, {wall, 9, ""}), Micros(0));
  EXPECT_EQ(since({wall, 5, "one"}, {"", 9, "two"}), std::nullopt);
  EXPECT_EQ(since({"", 5, "one"}, {wall, 9, "two"}), std::nullopt);
}

TEST(TapeZeros, AMomentHasEachPartOfItsDateWithinItsRange) {
  const std::string good = "2024-02-29T00:00:00Z";
  const auto seconds = [&](const std::string& text) -> std::optional<std::int64_t> {
    const auto apart = apart_by_wall(good, text);
    return apart ? std::optional(apart->count() / 1'000'000) : std::nullopt;
  };
  EXPECT_EQ(seconds("2024-02-29T23:59:60Z"), 86'400);  // a leap second
  EXPECT_EQ(seconds("2024-02-29T23:59:59Z"), 86'399);
  EXPECT_EQ(seconds("2024-03-01T00:00:00Z"), 86'400);
  EXPECT_EQ(seconds("2023-12-31T00:00:00Z"), -60 * 86'400);
  for (const char* wrong :
       {"2024-02-29T23:59:61Z", "2024-02-29T23:60:00Z", "2024-02-29T24:00:00Z", "2024-13-01T00:00:00Z",
        "2024-00-01T00:00:00Z", "2023-02-29T00:00:00Z", "2024-02-00T00:00:00Z", "2024-02-29T-1:00:00Z",
        "2024-02-29T00:-1:00Z", "2024-02-29T00:00:-1Z", "2024-02-29T00:00:0", "2024-02-29T00:00:0xZ",
        "2024-02-29T0x:00:00Z", "2024-02-29T00:0x:00Z", "2024-02-2xT00:00:00Z", "2024-0x-29T00:00:00Z",
        "202x-02-29T00:00:00Z"})
    EXPECT_EQ(seconds(wrong), std::nullopt) << wrong;
}

TEST(TapeZeros, AMomentHasItsSeparators) {
  for (const std::size_t at : {4U, 7U, 13U, 16U}) {
    std::string text = "2024-02-29T00:00:00Z";
    EXPECT_EQ(apart_by_wall(text, text), Micros(0));
    text[at] = '/';
    EXPECT_EQ(apart_by_wall(text, "2024-02-29T00:00:00Z"), std::nullopt) << text;
  }
}

TEST(TapeZeros, AFractionCountsToTheMicrosecond) {
  const auto fraction = [](const std::string& text) {
    return apart_by_wall("2024-02-29T00:00:00Z", "2024-02-29T00:00:00" + text);
  };
  EXPECT_EQ(fraction(".Z"), Micros(0));
  EXPECT_EQ(fraction(".9Z"), Micros(900'000));
  EXPECT_EQ(fraction(".123456Z"), Micros(123'456));
  EXPECT_EQ(fraction(".1234569Z"), Micros(123'456));
  EXPECT_EQ(fraction(".5+00:00"), Micros(500'000));
  for (const char* wrong : {"", ".", ".5", ".5/", ".5:", ",5Z", "5Z", ".5 Z"})
    EXPECT_EQ(fraction(wrong), std::nullopt) << wrong;
}

TEST(TapeZeros, AZoneIsHoursAndMinutes) {
  const auto zone = [](const std::string& text) {
    return apart_by_wall("2024-02-29T00:00:00" + text, "2024-02-29T00:00:00Z");
  };
  EXPECT_EQ(zone("Z"), Micros(0));
  EXPECT_EQ(zone("z"), Micros(0));
  EXPECT_EQ(zone("+02:30"), std::chrono::minutes(150));
  EXPECT_EQ(zone("-02:30"), std::chrono::minutes(-150));
  for (const char* wrong : {"", "Y", "ZZ", "+0230", "+02:3", "+02:300", "+02-30", "*02:30", "+x2:30",
                            "+02:x0", "+-2:30", "+02:-3"})
    EXPECT_EQ(zone(wrong), std::nullopt) << wrong;
}

TEST(TapeZeros, AreMovedOnBothClocks) {
  const TapeZero zero{"2024-02-29T00:00:00.5Z", 1'000, "boot"};
  EXPECT_EQ(later(zero, Micros(600'000)), (TapeZero{"2024-02-29T00:00:01.100000Z", 601'000, "boot"}));
  EXPECT_EQ(later(zero, Micros(-1'001)), (TapeZero{"2024-02-29T00:00:00.498999Z", -1, "boot"}));
  EXPECT_EQ(later({"some day", 1, "b"}, Micros(1)), (TapeZero{"some day", 2, "b"}));
  EXPECT_EQ(later({"", std::numeric_limits<std::int64_t>::max(), "b"}, Micros(1)), (TapeZero{"", 0, "b"}));
}

TEST(CompletedHeader, KeepsWhatIsToldAndFillsInTheRest) {
  const TapeHeader told{.device = "d", .driver = "p", .created = "c", .host = "h", .tool = "t", .id = "i"};
  EXPECT_EQ(completed(told), told);
  const TapeHeader made = completed(TapeHeader{.device = "d", .driver = "p"});
  std::array<char, 256> host{};
  ASSERT_EQ(::gethostname(host.data(), host.size() - 1), 0);
  EXPECT_EQ(made.host, host.data());
  EXPECT_EQ(made.tool, "porttape " + std::string(version()));
  EXPECT_THAT(made.id.raw(), MatchesRegex("[0-9a-f]{32}"));
  EXPECT_NE(completed(TapeHeader{}).id, made.id);
  const auto age = apart_by_wall(made.created.raw(), completed(TapeHeader{}).created.raw());
  ASSERT_TRUE(age);
  EXPECT_GE(*age, Micros(0));
  EXPECT_LT(*age, std::chrono::hours(1));
}

}  // namespace
}  // namespace porttape
