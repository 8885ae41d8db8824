// The pieces of the sentences of reports, at their limits.

#include "libport/replay/report_words.hpp"

#include <cstdint>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "libport/replay/faults_report.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/seconds_text.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::bytes_of;

TEST(ReportWords, MillisecondsHaveNoZerosAtTheirEnd) {
  EXPECT_EQ(millis_text(Micros{0}), "0 ms");
  EXPECT_EQ(millis_text(Micros{1}), "0.001 ms");
  EXPECT_EQ(millis_text(Micros{10}), "0.01 ms");
  EXPECT_EQ(millis_text(Micros{12'345}), "12.345 ms");
  EXPECT_EQ(millis_text(Micros{100'000}), "100 ms");
}

TEST(ReportWords, OneHasNoPlural) {
  EXPECT_EQ(counted(0, "byte"), "0 bytes");
  EXPECT_EQ(counted(1, "byte"), "1 byte");
  EXPECT_EQ(counted(2, "byte"), "2 bytes");
}

TEST(ReportWords, NumbersUpToTenAreWords) {
  EXPECT_EQ(number_word(0), "no");
  EXPECT_EQ(number_word(1), "one");
  EXPECT_EQ(number_word(10), "ten");
  EXPECT_EQ(number_word(11), "11");
}

TEST(ReportWords, BytesAreTextWhereAtLeastHalfOfThemCanBeRead) {
  EXPECT_EQ(bytes_text(bytes_of("a\x01")), "\"a\\x01\"");
  EXPECT_EQ(bytes_text(bytes_of("a\x01\x02")), "61 01 02");
  EXPECT_EQ(bytes_text({}), "\"\"");
}

TEST(ReportWords, WhatCanBeReadIsAsciiAndTheEndsOfLines) {
  EXPECT_EQ(bytes_text(bytes_of(" ")), "\" \"");
  EXPECT_EQ(bytes_text(bytes_of("\x1f")), "1f");
  EXPECT_EQ(bytes_text(bytes_of("~")), "\"~\"");
  EXPECT_EQ(bytes_text(bytes_of("\x7f")), "7f");
  EXPECT_EQ(bytes_text(bytes_of("\r")), "\"\\r\"");
  EXPECT_EQ(bytes_text(bytes_of("\n")), "\"\\n\"");
  EXPECT_EQ(bytes_text(bytes_of("\t")), "\"\\t\"");
}

TEST(ReportWords, SixteenBytesOfEachSideAreShown) {
  const Bytes sixteen(16, 'b');
  const Bytes more(17, 'b');
  EXPECT_EQ(bytes_text(Bytes(16, 'a'), sixteen), '"' + std::string(16, 'a') + std::string(16, 'b') + '"');
  EXPECT_EQ(bytes_text(Bytes(17, 'a'), sixteen), "..\"" + std::string(16, 'a') + std::string(16, 'b') + '"');
  EXPECT_EQ(bytes_text(more), '"' + std::string(16, 'b') + "\"..");
  EXPECT_EQ(bytes_text(bytes_of("x" + std::string(16, 'a')), {}), "..\"" + std::string(16, 'a') + '"')
      << "the last of what is before";
}

TEST(ReportWords, NamedBytesHaveTheirTextWhereAllOfItCanBeRead) {
  EXPECT_EQ(named_bytes(bytes_of("P\n")), "\"P\\n\" (50 0a)");
  EXPECT_EQ(named_bytes(bytes_of("P\x01")), "50 01");
  EXPECT_EQ(named_bytes(Bytes(2, 0)), "00 00");
}

TEST(ReportWords, SixteenNamedBytesAreShown) {
  EXPECT_EQ(named_bytes(Bytes(16, 0)), spaced_hex(Bytes(16, 0)));
  EXPECT_EQ(named_bytes(Bytes(17, 0)), spaced_hex(Bytes(16, 0)) + " ..");
}

TEST(ReportWords, SecondsHaveSixPlacesAndASignWhereTheyAreNegative) {
  EXPECT_EQ(seconds_text(0), "0.000000 s");
  EXPECT_EQ(seconds_text(-1), "-0.000001 s");
  EXPECT_EQ(seconds_text(1'000'000), "1.000000 s");
  EXPECT_EQ(seconds_text(-61'000'001), "-61.000001 s");
  EXPECT_EQ(seconds_text(std::numeric_limits<std::int64_t>::min()), "-9223372036854.775808 s");
}

LineFault fault(std::string_view kind) { return {.kind = kind, .spec = "drop:at=1"}; }

TEST(FaultsReportText, SaysHowManyOfEachKindWereMade) {
  FaultsReport faults{.plan = "drop;corrupt", .seed = 7};
  EXPECT_EQ(to_text(faults), "none made by drop;corrupt; seed 7");
  faults.add(fault("drop"));
  EXPECT_EQ(to_text(faults), "1 made (1 drop) by drop;corrupt; seed 7");
  faults.add(fault("drop"));
  faults.add(fault("corrupt"));
  EXPECT_EQ(to_text(faults), "3 made (1 corrupt, 2 drop) by drop;corrupt; seed 7");
}

TEST(FaultsReportText, ALongPlanIsCut) {
  EXPECT_EQ(to_text(FaultsReport{.plan = std::string(200, 'p')}),
            "none made by " + std::string(200, 'p') + "; seed 0");
  EXPECT_EQ(to_text(FaultsReport{.plan = std::string(201, 'p')}),
            "none made by " + std::string(200, 'p') + "…; seed 0");
}

TEST(FaultsReportTest, TheFirstThousandAreListedAndAllAreCounted) {
  FaultsReport faults;
  for (int i = 0; i < 1001; ++i) faults.add(fault("drop"));
  EXPECT_EQ(faults.list.size(), 1000U);
  EXPECT_EQ(faults.made, 1001U);
  EXPECT_EQ(faults.kinds.at("drop"), 1001U);
}

TEST(FaultsReportTest, ThoseThatAreNotToldSinglyCountAndAreNotListed) {
  FaultsReport faults;
  faults.add({.kind = LineFault::kMore, .count = 5});
  EXPECT_EQ(faults.made, 5U);
  EXPECT_TRUE(faults.list.empty());
}

TEST(FaultsReportTest, JsonHasThePlanAndEachFaultThatIsListed) {
  FaultsReport faults{.plan = "drop:p=0.1", .seed = 7};
  faults.add({.kind = "drop", .spec = "drop:at=3,dir=w", .dir = LineDir::w, .offset = 3});
  faults.add({.kind = "stall", .spec = "stall:at=1"});
  EXPECT_EQ(to_json(faults), R"({"plan":"drop:p=0.1","seed":7,"made":2,"kinds":{"drop":1,"stall":1},"list":[)"
                             R"({"kind":"drop","dir":"w","offset":3,"spec":"drop:at=3,dir=w"},)"
                             R"({"kind":"stall","spec":"stall:at=1"}]})");
}

}  // namespace
}  // namespace porttape
