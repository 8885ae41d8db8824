#include "libport/rules/rules_check.hpp"

#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "tests/rules/rules_rig.hpp"
#include "tests/support/memory_tape.hpp"

namespace porttape::test {
namespace {

constexpr std::string_view kCheckedLine = "[[frame]]\nname = 'line'\nkind = 'delimited'\nend = \"\\n\"\n";

RulesReport checked(const std::string& rules, const MemoryTape& tape,
                    std::size_t piece = std::size_t{1} << 20) {
  const RuleBook book(rules_of(std::string(kCheckedLine) + rules));
  RulesCheck check(book);
  MemorySource source(tape, MemorySource::Select::merged, piece);
  for (auto record = source.next(); record && *record; record = source.next()) check.pass(**record);
  return check.finish();
}

std::string text(const RulesReport::Use& use) {
  return std::to_string(use.count) + " at " + std::to_string(to_us(use.first.at)) + " us, byte " +
         std::to_string(use.first.offset) + ", exchange " + std::to_string(use.first.exchange) + ": " +
         std::string(as_text(use.frame)) + " " + std::to_string(use.span.begin) + " to " +
         std::to_string(use.span.end);
}

const std::string kFirst = "[[rule]]\nname = 'first'\nwhen = '^T'\nat = 1\nsize = 1\nignore = true\n";

TEST(RulesCheckTest, EachUseIsCountedWithItsFirstPlace) {
  const MemoryTape tape = MemoryTape()
                              .write(5, "go\n")
                              .read(6, "ok\n")
                              .write(10, "T1\nT2\n")
                              .write(11, "T3\n")
                              .read(12, "ok\n")
                              .write(20, "T4\nrest");
  for (const std::size_t piece : {1U, 2U, 5U, 100U}) {
    const RulesReport report = checked(kFirst, tape, piece);
    EXPECT_EQ(report.frames, 5U);
    EXPECT_EQ(report.exchanges, 3U);
    EXPECT_EQ(text(report.rules[0]), "4 at 10 us, byte 3, exchange 2: T1\n 1 to 2");
    EXPECT_EQ(text(report.untouched), "1 at 5 us, byte 0, exchange 1: go\n 0 to 3");
    EXPECT_EQ(report.unframed.count, 4U);
    EXPECT_EQ(report.unframed.first.offset, 15U);
    EXPECT_EQ(report.unframed.first.exchange, 3U);
    EXPECT_EQ(report.formats[0].name, "line");
    EXPECT_EQ(report.formats[0].frames, 5U);
    EXPECT_EQ(report.formats[0].checksum_held + report.formats[0].checksum_wrong, 0U);
    EXPECT_FALSE(report.any_trouble());
  }
}

TEST(RulesCheckTest, AnExchangeIsARunOfWritesAndItsAnswer) {
  EXPECT_EQ(checked(kFirst, MemoryTape().read(1, "hello\n")).exchanges, 0U);
  EXPECT_EQ(checked(kFirst, MemoryTape().write(1, "T1\n")).exchanges, 1U);
  EXPECT_EQ(checked(kFirst, MemoryTape().write(1, "T1\n").read(2, "x")).exchanges, 1U);
  EXPECT_EQ(checked(kFirst, MemoryTape().write(1, "T1\n").read(2, "x").write(3, "T1\n")).exchanges, 2U);
  EXPECT_EQ(checked(kFirst, MemoryTape().write(1, "T1\n").read(2, "").write(3, "T1\n")).exchanges, 1U);
}

TEST(RulesCheckTest, AnAnswerEndsAFrameThatIsNotWhole) {
  const RulesReport report =
      checked(kFirst, MemoryTape().write(1, "T1").read(2, "x").write(3, "2\n").write(4, "T3\n"));
  EXPECT_EQ(report.frames, 2U);
  EXPECT_EQ(report.unframed.count, 2U);
  EXPECT_EQ(report.rules[0].count, 1U);
  EXPECT_EQ(report.rules[0].first.offset, 4U);
}

TEST(RulesCheckTest, APauseEndsAFrameThatEndsByIt) {
  const RuleBook book(
      rules_of("[[frame]]\nname='p'\nkind='idle'\nidle_ms=2\n[[rule]]\nname='r'\nat=0\n"
               "ignore=true\n"));
  RulesCheck check(book);
  const MemoryTape tape = MemoryTape().write(0, "a").write(1'999, "b").write(3'999, "c").write(5'998, "d");
  MemorySource source(tape);
  for (auto record = source.next(); record && *record; record = source.next()) check.pass(**record);
  const RulesReport report = check.finish();
  EXPECT_EQ(report.frames, 2U);
  EXPECT_EQ(text(report.rules[0]), "2 at 0 us, byte 0, exchange 1: ab 0 to 2");
}

TEST(RulesCheckTest, ChecksumsThatHoldAndThoseThatDoNotAreCounted) {
  const RuleBook book(rules_of("[[frame]]\nprotocol='nmea'\n[[rule]]\nname='r'\nat=0\nignore=true\n"));
  RulesCheck check(book);
  const MemoryTape tape =
      MemoryTape().write(0, "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n$A*00\r\n$A*01\r\n!A*41\r\n");
  MemorySource source(tape);
  for (auto record = source.next(); record && *record; record = source.next()) check.pass(**record);
  const RulesReport report = check.finish();
  ASSERT_EQ(report.formats.size(), 2U);
  EXPECT_EQ(report.formats[0].frames, 3U);
  EXPECT_EQ(report.formats[0].checksum_held, 1U);
  EXPECT_EQ(report.formats[0].checksum_wrong, 2U);
  EXPECT_EQ(report.formats[1].frames, 1U);
  EXPECT_EQ(report.formats[1].checksum_held, 1U);
}

TEST(RulesCheckTest, WhatOverlapsIsCountedByPairs) {
  const std::string rules = kFirst +
                            "[[rule]]\nname='b'\nat=1\nsize=2\nignore=true\n"
                            "[[rule]]\nname='c'\nat=0\nsize=2\nignore=true\n";
  const RulesReport report = checked(rules, MemoryTape().write(7, "T11\nT22\nx11\n"));
  ASSERT_EQ(report.overlaps.size(), 3U);
  const auto pair = [&](std::size_t i) {
    return std::to_string(report.overlaps[i].one) + "-" + std::to_string(report.overlaps[i].other) + " " +
           text(report.overlaps[i].use);
  };
  EXPECT_EQ(pair(0), "0-1 2 at 7 us, byte 0, exchange 1: T11\n 0 to 4");
  EXPECT_EQ(pair(1), "0-2 2 at 7 us, byte 0, exchange 1: T11\n 0 to 4");
  EXPECT_EQ(pair(2), "1-2 1 at 7 us, byte 8, exchange 1: x11\n 0 to 4");
  EXPECT_TRUE(report.any_trouble());
}

const std::string kReply =
    "[[reply]]\nname='r'\nwhen='^T'\nfrom={at=1,size=1}\nanswer='^A'\nto={at=1,size=2}\n";

TEST(RulesCheckTest, AReplyIsOfTheLastRequestBeforeItsAnswer) {
  const RulesReport report = checked(kReply, MemoryTape()
                                                 .write(1, "T1\n")
                                                 .write(2, "T2\nx\n")
                                                 .read(3, "B1\nA22\nA33\nA")
                                                 .read(4, "44")
                                                 .write(5, "x\n")
                                                 .read(6, "A55\n")
                                                 .write(7, "T3\n")
                                                 .read(8, "A\n"));
  EXPECT_EQ(text(report.replies[0]), "2 at 2 us, byte 3, exchange 1: T2\n 1 to 2");
  EXPECT_FALSE(report.any_trouble());
}

TEST(RulesCheckTest, ARequestWithoutTheReplysPlaceIsNoUse) {
  const RulesReport report = checked("[[reply]]\nname='r'\nwhen='^T'\nfrom={at=3,size=1}\nto={at=0,size=1}\n",
                                     MemoryTape().write(1, "T99\n").write(2, "T\n").read(3, "A\n"));
  EXPECT_EQ(report.replies[0].count, 0U) << "the latest is the request";
  EXPECT_TRUE(report.any_trouble());
}

TEST(RulesCheckTest, OfAnExchangeTheFirst4096RequestsMayBeMeant) {
  const auto uses = [](std::size_t before) {
    std::string requests;
    for (std::size_t i = 0; i < before; ++i) requests += "x\n";
    return checked(kReply, MemoryTape().write(1, requests + "T1\n").read(2, "A11\n")).replies[0].count;
  };
  EXPECT_EQ(uses(4095), 1U);
  EXPECT_EQ(uses(4096), 0U);
}

TEST(RulesCheckTest, TheLastAnswerCountsToo) {
  EXPECT_EQ(checked(kReply, MemoryTape().write(1, "T1\n").read(2, "A11\n")).replies[0].count, 1U);
  EXPECT_EQ(checked(kReply, MemoryTape().write(1, "T1\n")).replies[0].count, 0U);
}

}  // namespace
}  // namespace porttape::test
