#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

class StatsTest : public testing::Test {
 protected:
  test::TempDir dir;
  std::string gps = make_tape(dir, "gps", {{100, "$GPGGA,1*00\r\n"}, {5'000'100, "$GPGGA,2*00\r\n"}},
                              {{1'000'000, "$PMTK605*31\r\n"}});
};

TEST_F(StatsTest, InWords) {
  const auto ran = run({"stats", gps, "--protocol", "nmea"});
  EXPECT_EQ(ran.status, 0);
  EXPECT_EQ(ran.err, "");
  EXPECT_EQ(ran.out,
            "gps.log\n"
            "  duration   5.000100 s\n"
            "  exchanges  1, 1 answered\n"
            "  answers    after 4.00 s to 4.00 s, median 4.00 s, p90 4.00 s, p99 4.00 s\n"
            "  read       26 bytes in 2 blocks, 5.20 B/s, busiest second 13 bytes at 0 s\n"
            "  write      13 bytes in 1 blocks, 2.60 B/s, busiest second 13 bytes at 1 s\n"
            "  silences   1 of 1.00 s or longer, 4.00 s in all; the longest:\n"
            "             4.00 s from 1.000000 s on\n"
            "\n"
            "  written                      count       bytes unanswered    median       p99       max  the "
            "max at\n"
            "  PMTK605                          1          13          0    4.00 s    4.00 s    4.00 s  "
            "1.000000 s\n"
            "\n"
            "  read                         count       bytes                every       p99       max  the "
            "max at\n"
            "  GPGGA                            2          26               5.00 s    5.00 s    5.00 s  "
            "0.000100 s\n"
            "\n"
            "  slowest answers\n"
            "     4.00 s  exchange 1 at 1.000000 s  PMTK605\n");
}

TEST_F(StatsTest, ATapeWithoutAnswersHasNoTimesOfThem) {
  const std::string mute = make_tape(dir, "mute", {}, {{1'000'000, "x"}, {2'000'000, "y"}});
  const auto ran = run({"stats", mute});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.out, AllOf(HasSubstr("  exchanges  1, 0 answered\n"), Not(HasSubstr("  answers "))));
}

TEST_F(StatsTest, TheTableOfExchanges) {
  EXPECT_EQ(run({"stats", gps, "--exchanges"}).out,
            "exchange           at, s     answer  written     read  command\n"
            "       1        1.000000     4.00 s       13       13  $PMTK\n");
  EXPECT_EQ(run({"stats", gps, "--exchanges", "--json"}).out,
            "{\"exchange\":1,\"t_us\":1000000,\"until_us\":5000100,\"answer_us\":4000100,\"written\":13,"
            "\"read\":13,"
            "\"command\":\"$PMTK\"}\n");
}

TEST_F(StatsTest, AsJson) {
  EXPECT_THAT(run({"stats", gps, "--protocol", "nmea", "--json"}).out,
              AllOf(StartsWith("{\"tape\":\"gps.log\",\"duration_us\":5000100,\"exchanges\":1,\"answered\":1,"
                               "\"answer_us\":{\"min\":4000100,"),
                    HasSubstr("\"interval_us\":{\"min\":5000000,"),
                    HasSubstr("\"longest_silences\":[{\"from_us\":1000000,\"length_us\":4000100}]"),
                    HasSubstr("\"unanswered\":0,\"answer_us\":{\"min\":4000100,")));
}

TEST_F(StatsTest, ByTheFramesOfARulesFile) {
  const std::string head = "format = 'porttape-rules'\nversion = 1\n";
  const std::string rule = "[[rule]]\nname = 'r'\nat = 0\nsize = 1\nregex = '.'\n";
  test::write_file(
      dir / "lines.rules",
      test::bytes_of(head + "[[frame]]\nname = 'line'\nkind = 'delimited'\nend = \"\\r\\n\"\n" + rule));
  EXPECT_THAT(run({"stats", gps, "--rules", dir / "lines.rules"}).out,
              HasSubstr("  $PMTK                            1 "));
  test::write_file(dir / "none.rules", test::bytes_of(head + rule));
  const auto none = run({"stats", gps, "--rules", dir / "none.rules"});
  EXPECT_EQ(none.status, 2);
  EXPECT_THAT(none.err, HasSubstr("a [[frame]] does"));
}

TEST_F(StatsTest, DamageIs1) {
  const std::string bad = make_tape(dir, "bad", {{2'000'000, "a"}, {1'000'000, "b"}}, {});
  const auto ran = run({"stats", bad});
  EXPECT_EQ(ran.status, 1);
  EXPECT_EQ(ran.out, "");
  EXPECT_THAT(ran.err, HasSubstr("porttape recover"));
}

}  // namespace
}  // namespace porttape
