#include <filesystem>

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

class DiffTest : public testing::Test {
 protected:
  test::TempDir dir;
  std::string good =
      make_tape(dir, "good", {{1'002'000, "OK\r\n"}, {2'002'000, "1<2\n"}, {3'002'000, "same"}},
                {{1'000'000, "AT\r"}, {2'000'000, "x?\r"}, {3'000'000, "y"}},
                "{\"t_us\":0,\"event\":\"open\"}\n"
                "{\"t_us\":500,\"event\":\"settings\",\"by\":\"driver\",\"baud\":300}\n");
  std::string bad =
      make_tape(dir, "bad", {{1'202'000, "OK\r\n"}, {2'202'000, "1<3\n"}, {3'202'000, "same"}},
                {{1'000'000, "AT\r"}, {2'200'000, "x?\r"}, {3'200'000, "y"}, {4'000'000, "more"}},
                "{\"t_us\":0,\"event\":\"open\"}\n"
                "{\"t_us\":600,\"event\":\"settings\",\"by\":\"driver\",\"baud\":9600}\n");
};

TEST_F(DiffTest, SaysInOrderWhatDiffersAndGives3) {
  const auto ran = run({"diff", good, bad});
  EXPECT_EQ(ran.status, 3);
  EXPECT_EQ(ran.err, "");
  EXPECT_EQ(ran.out,
            "different: 1 added, 2 changed, 1 slower\n"
            "  - good.log: 3 exchanges, 2 events\n"
            "  + bad.log: 4 exchanges, 2 events\n"
            "  2 of 4 exchanges and parts are the same; times count from 100.0 ms on\n"
            "changed  settings at 0.000600 s, was settings at 0.000500 s\n"
            "  - settings  driver: 300 baud\n"
            "  + settings  driver: 9600 baud\n"
            "slower   exchange 1 at 1.000000 s: the answer comes after 202.0 ms, was 2.00 ms\n"
            "changed  exchange 2 at 2.200000 s, was exchange 2 at 2.000000 s: the answer from byte 2 on\n"
            "  - r      0  \"1<2\\n\"  313c320a\n"
            "  + r      0  \"1<3\\n\"  313c330a\n"
            "added    exchange 4 at 4.000000 s\n"
            "  + w      0  \"more\"  6d6f7265\n");
}

TEST_F(DiffTest, OfTheSameTapeIs0) {
  const auto ran = run({"diff", good, good});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.out, HasSubstr("same: good.log and good.log\n"));
}

TEST_F(DiffTest, TimesAndEventsCanBeLeftOut) {
  EXPECT_THAT(run({"diff", good, bad, "--margin", "0.3"}).out, Not(HasSubstr("slower")));
  EXPECT_THAT(run({"diff", good, bad, "--margin", "off"}).out,
              AllOf(HasSubstr("times do not count"), Not(HasSubstr("slower"))));
  EXPECT_THAT(run({"diff", good, bad, "--no-events"}).out,
              AllOf(HasSubstr("events are not compared"), Not(HasSubstr("settings"))));
}

TEST_F(DiffTest, JsonIsALineForTheTapesAndOneForEachDifference) {
  const auto ran = run({"diff", "--json", good, bad});
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out,
              HasSubstr(R"({"same":false,"one":{"tape":"good.log","exchanges":3,"turns":3,"events":2},)"
                        R"("other":{"tape":"bad.log","exchanges":4,"turns":4,"events":2},"same_turns":2,)"
                        R"("margin_us":100000,"events_compared":true,"counts":{"added":1,"missing":0,)"
                        R"("changed":2,"moved":0,"slower":1,"faster":0}})"));
  EXPECT_THAT(ran.out, HasSubstr(R"({"kind":"slower","time":"answer","one":{"t_us":1000000,)"));
  EXPECT_THAT(run({"diff", "--json", bad, good}).out,
              HasSubstr(R"({"kind":"faster","time":"answer","one":{"t_us":1000000,)"));
  EXPECT_THAT(ran.out, HasSubstr(R"("dir":"r","offset":2,"one_hex":"320a","other_hex":"330a"})"));
  EXPECT_THAT(ran.out, HasSubstr(R"("event":{"t_us":600,"event":"settings","by":"driver","baud":9600}})"));
}

TEST_F(DiffTest, ShowsAFewOfMany) {
  std::vector<test::Block> other;
  for (int i = 0; i < 30; ++i) other.push_back({4'000'000 + i, "more"});
  std::vector<test::Block> asked;
  for (int i = 0; i < 30; ++i) asked.push_back({4'000'000 + i, "a" + std::to_string(i)});
  const std::string many = make_tape(dir, "many", other, asked);
  EXPECT_THAT(run({"diff", good, many}).out, HasSubstr("\n... and 10 more; --all shows them\n"));
  EXPECT_THAT(run({"diff", good, many, "--all"}).out, Not(HasSubstr(" more; ")));
}

TEST_F(DiffTest, ThePageEscapesWhatIsOnATapeAndMarksWhatDiffers) {
  const std::string page = dir / "page.html";
  const auto ran = run({"diff", good, bad, "--html", page});
  EXPECT_EQ(ran.status, 3);
  const std::string html(as_text(test::read_file(page)));
  EXPECT_THAT(html, HasSubstr("1&lt;<mark>3</mark>\\n"));
  EXPECT_THAT(html, HasSubstr("313c<mark>33</mark>0a"));
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  EXPECT_THAT(html, HasSubstr("</html>\n"));
  const auto again = run({"diff", good, bad, "--html", page});
  EXPECT_EQ(again.status, 2);
  EXPECT_THAT(again.err, HasSubstr("--overwrite"));
  EXPECT_EQ(run({"diff", good, good, "--html", page, "--overwrite"}).status, 0);
}

TEST_F(DiffTest, DamageIs1AndLeavesNoPage) {
  Bytes bytes = test::read_file(bad + "r");
  bytes.at(4) = 0xff;
  test::write_file(bad + "r", bytes);
  const std::string page = dir / "page.html";
  const auto ran = run({"diff", good, bad, "--html", page});
  EXPECT_EQ(ran.status, 1);  // it begins with no block, beside events
  bytes.at(4) = 0;
  bytes.at(12 + 4 + 4) = 0xff;
  test::write_file(bad + "r", bytes);
  const auto damaged = run({"diff", good, bad, "--html", page});
  EXPECT_EQ(damaged.status, 1);
  EXPECT_THAT(damaged.err, HasSubstr("porttape recover TAPE"));
  EXPECT_FALSE(std::filesystem::exists(page));
}

}  // namespace
}  // namespace porttape
