#include "libport/rules/rule_book.hpp"

#include <string>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/rule_replies.hpp"
#include "tests/rules/rules_rig.hpp"

namespace porttape::test {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::StartsWith;

constexpr std::string_view kBookLine = "[[frame]]\nname = 'line'\nkind = 'delimited'\nend = \"\\n\"\n";

RuleBook book_of(const std::string& keys) {
  return RuleBook(rules_of(std::string(kBookLine) + "[[rule]]\nname = 'r'\n" + keys));
}

// What is wrong with what came for the recorded frame; empty: nothing.
std::string wrong(const std::string& keys, std::string_view recorded, std::string_view came) {
  const RuleBook book = book_of(keys);
  RuleBook::Counted counted;
  const auto judged = book.judge(0, as_bytes(recorded), as_bytes(came), counted);
  EXPECT_NE(judged.right, !judged.why.empty()) << came;
  return judged.why;
}

TEST(RuleBookTest, EachRuleSaysWhatIsWrong) {
  EXPECT_THAT(wrong("at=1\nsize=2\nignore=true\n", "abcd\n", "aXYd\n"), "");
  EXPECT_THAT(wrong("at=0\nsize=2\nmask='f00f'\n", "12\n", "2b\n"), "");
  const std::string mask = wrong("at=0\nsize=2\nmask='f00f'\n", "12\n", "1c\n");
  EXPECT_THAT(mask, StartsWith("rule 'r' (my.rules:5): "));
  EXPECT_THAT(mask, EndsWith(" differs from 3132 in bits of the mask"));
  EXPECT_THAT(wrong("at=0\nto=-1\nregex='\\d+'\n", "12\n", "1x\n"), EndsWith(" does not match \\d+"));
  EXPECT_THAT(wrong("at=0\nto=-1\nregex='\\d+'\n", "12\n", "34\n"), "");
  const std::string range = "at=0\nto=-1\nrange=[2, 5.5]\ntype='decimal'\nlength=[1,3]\n";
  for (const char* const right : {"2\n", "5.5\n", "9\n"}) EXPECT_EQ(wrong(range, "9\n", right), "") << right;
  EXPECT_THAT(wrong(range, "3\n", "5.6\n"), EndsWith(" is 5.6; accepted: 2 to 5.5"));
  EXPECT_THAT(wrong(range, "3\n", "1.9\n"), EndsWith(" is 1.9; accepted: 2 to 5.5"));
  EXPECT_THAT(wrong(range, "3\n", "x\n"), EndsWith(" is no number"));
  EXPECT_THAT(wrong(range, "3\n", "2.00\n"), EndsWith(" has 4 bytes; accepted: 1 to 3"));
  EXPECT_THAT(wrong(range, "3\n", "\n"), EndsWith(" has 0 bytes; accepted: 1 to 3"));
}

TEST(RuleBookTest, ACounterGoesOnAsTheTapesDoes) {
  const RuleBook book = book_of("at=0\nto=-1\ncounter=true\ntype='decimal'\n");
  RuleBook::Counted counted;
  const auto judged = [&](const std::string& recorded, const std::string& came) {
    const auto is = book.judge(0, as_bytes(recorded), as_bytes(came), counted);
    return is.right ? std::string("right") : is.why;
  };
  EXPECT_EQ(judged("10\n", "70\n"), "right");
  EXPECT_EQ(judged("12\n", "72\n"), "right");
  EXPECT_THAT(judged("13\n", "74\n"), EndsWith(" is 74 after 72; due: 73"));
  EXPECT_EQ(judged("13\n", "73\n"), "right") << "what was wrong has not counted";
  EXPECT_THAT(judged("13\n", "xx\n"), EndsWith(" is no number"));
  EXPECT_EQ(judged("xx\n", "xx\n"), "right");
  EXPECT_THAT(judged("xx\n", "74\n"), EndsWith(" stands for what is no number on the tape"));
  book.skip(0, as_bytes("20\n"), counted);  // left out
  EXPECT_EQ(judged("21\n", "74\n"), "right");
  book.repeat(0, as_bytes("80\n"), counted);  // one that the tape has not
  EXPECT_EQ(judged("22\n", "81\n"), "right");
}

TEST(RuleBookTest, WhereTheDifferenceBeginsIsTold) {
  const RuleBook book = book_of("capture='T=(\\d+);'\nregex='\\d+'\nlength=[1,9]\n");
  const auto at = [&](std::string_view recorded, std::string_view came) {
    RuleBook::Counted counted;
    const auto judged = book.judge(0, as_bytes(recorded), as_bytes(came), counted);
    EXPECT_FALSE(judged.right);
    EXPECT_EQ(judged.why, "");
    return std::to_string(judged.recorded) + " " + std::to_string(judged.came);
  };
  EXPECT_EQ(at("aT=1;bc\n", "xT=22;bc\n"), "0 0");
  EXPECT_EQ(at("aT=1;bc\n", "aT=333;bx\n"), "6 8");
  EXPECT_EQ(at("aT=1;bc\n", "aT=333;bc"), "7 9");
  EXPECT_EQ(at("aT=1;b\n", "aT=333;b\nx"), "7 9");
  EXPECT_EQ(at("aT=1;b\n", "aaT=3;b\n"), "1 1");
  EXPECT_EQ(at("aT=1;b\n", "abc\n"), "1 1");
}

const std::string kSum =
    "[[frame]]\nname='line'\nkind='delimited'\nend=\"\\n\"\n"
    "checksum={kind='XOR',at=-3,to=-3,hex=true}\n"
    "[[rule]]\nname='r'\nat=0\nsize=1\nignore=true\n";

TEST(RuleBookTest, AWrongChecksumIsToldWithTheRightOne) {
  const RuleBook book(rules_of(kSum));
  RuleBook::Counted counted;
  const auto judged = book.judge(0, as_bytes("ab03\n"), as_bytes("cb02\n"), counted);
  EXPECT_FALSE(judged.right);
  EXPECT_EQ(judged.why, "the checksum XOR is 02 and should be 01");
  EXPECT_EQ(judged.recorded, 2U);
  EXPECT_TRUE(book.judge(0, as_bytes("ab03\n"), as_bytes("cb01\n"), counted).right);
  EXPECT_FALSE(book.judge(0, as_bytes("ab04\n"), as_bytes("cb01\n"), counted).right)
      << "compared as it stands";
  EXPECT_EQ(book.checksum_holds(0, as_bytes("ab03\n")), true);
  EXPECT_EQ(book.checksum_holds(0, as_bytes("ab04\n")), false);
  EXPECT_EQ(book_of("at=0\nignore=true\n").checksum_holds(0, as_bytes("ab03\n")), std::nullopt);
}

std::string mended(const RuleBook& book, std::string_view before, std::string_view after, int format = 0) {
  Bytes frame(after.begin(), after.end());
  book.mend(format, as_bytes(before), frame);
  return std::string(as_text(frame));
}

TEST(RuleBookTest, MendingWritesLengthAndChecksumAnewWhereTheyWereRight) {
  using namespace std::string_literals;
  const RuleBook sum(rules_of(kSum));
  EXPECT_EQ(mended(sum, "ab03\n", "cb03\n"), "cb01\n");
  EXPECT_EQ(mended(sum, "ab04\n", "cb04\n"), "cb04\n");
  EXPECT_EQ(mended(sum, "ab03\n", "cb03\n", -1), "cb03\n");
  const std::string rule = "[[rule]]\nname='r'\nat=0\nsize=1\nignore=true\n";
  for (const bool little : {false, true}) {
    const RuleBook length(rules_of("[[frame]]\nname='f'\nkind='length'\nlength={at=1,size=2,adds=3,order='"s +
                                   (little ? "little" : "big") + "'}\n" + rule));
    const std::string body(0x102, 'x');
    EXPECT_EQ(mended(length, "a\x00\x02xx"s, "a\x00\x02"s + body),
              (little ? "a\x02\x01" : "a\x01\x02") + body);
    EXPECT_EQ(mended(length, "a\x09\x09xx"s, "b\x09\x09yy"s), "b\x09\x09yy"s) << "as long as before";
  }
}

TEST(RuleBookTest, ALayoutHasWhatIsAboutTheFrameByPlace) {
  const RuleBook book(rules_of(std::string(kBookLine) +
                               "[[rule]]\nname='a'\nat=3\nsize=1\nignore=true\n"
                               "[[rule]]\nname='b'\nat=1\nsize=2\nignore=true\n"
                               "[[rule]]\nname='c'\nat=2\nsize=1\nignore=true\n"
                               "[[rule]]\nname='d'\nat=9\nsize=1\nignore=true\n"
                               "[[rule]]\nname='e'\nwhen='x'\noptional=true\nwith_answer=false\n"
                               "[[rule]]\nname='f'\nwhen='y'\noptional=true\nwith_answer=true\n"
                               "[[rule]]\nname='g'\nwhen='z'\nrepeated=true\n"));
  const FrameLayout layout = book.layout(as_bytes("abcdxy\n"), 0);
  ASSERT_EQ(layout.fields.size(), 2U);
  EXPECT_EQ(layout.fields[0].span, (FrameSpan{1, 3}));
  EXPECT_EQ(layout.fields[0].rule, 1);
  EXPECT_EQ(layout.fields[1].span, (FrameSpan{3, 4}));
  EXPECT_THAT(layout.rules, testing::ElementsAre(0, 1, 2, 4, 5));
  EXPECT_THAT(layout.overlaps, testing::ElementsAre(std::pair(1, 2)));
  EXPECT_TRUE(layout.optional);
  EXPECT_EQ(layout.with_answer, false) << "the first rule's";
  EXPECT_FALSE(layout.varies);
  EXPECT_TRUE(book.any_repeated());
  EXPECT_EQ(book.repeats(as_bytes("xz\n"), 0), 6);
  EXPECT_EQ(book.repeats(as_bytes("xz\n"), -1), std::nullopt);
  EXPECT_EQ(book.repeats(as_bytes("x\n"), 0), std::nullopt);
  EXPECT_FALSE(book.layout(as_bytes("abcd\n"), 0).optional);
  EXPECT_TRUE(book.layout(as_bytes("abcdxy\n"), -1).rules.empty());
  EXPECT_FALSE(book_of("at=0\nignore=true\n").any_repeated());
}

TEST(RuleBookTest, AFrameVariesWhereOneOfItsFieldsDoes) {
  const std::string frame = "[[frame]]\nname='f'\nkind='length'\nlength={at=1,size=1,adds=3}\n";
  const std::string fixed = "[[rule]]\nname='a'\nat=0\nsize=1\nignore=true\n";
  const std::string varying = "[[rule]]\nname='b'\nat=2\nto=-1\nignore=true\nlength=[0,9]\n";
  const std::string_view bytes = "a\x03xyz!";
  for (const std::string& rules : {varying + fixed, fixed + varying}) {
    const FrameLayout layout = RuleBook(rules_of(frame + rules)).layout(as_bytes(bytes), 0);
    EXPECT_TRUE(layout.varies) << rules;
    ASSERT_EQ(layout.fields.size(), 3U) << rules;
    EXPECT_EQ(layout.fields[1].of, FrameField::Of::length) << "it follows from what comes";
    EXPECT_EQ(layout.fields[1].span, (FrameSpan{1, 2}));
  }
  const FrameLayout layout = RuleBook(rules_of(frame + fixed)).layout(as_bytes(bytes), 0);
  EXPECT_FALSE(layout.varies);
  EXPECT_EQ(layout.fields.size(), 1U) << "the length is as recorded";
}

TEST(RuleBookTest, FramesThatTouchDoNotOverlap) {
  const RuleBook book(rules_of(std::string(kBookLine) + "[[rule]]\nname='a'\nat=1\nsize=1\nignore=true\n"
                                                        "[[rule]]\nname='b'\nat=2\nsize=1\nignore=true\n"
                                                        "[[rule]]\nname='c'\nat=0\nsize=1\nignore=true\n"));
  const FrameLayout layout = book.layout(as_bytes("abc\n"), 0);
  EXPECT_TRUE(layout.overlaps.empty());
  ASSERT_EQ(layout.fields.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(layout.fields[i].span, (FrameSpan{i, i + 1}));
}

TEST(RuleBookTest, ItKnowsTheLongestFrameAndTheShortestPause) {
  const std::string rule = "[[rule]]\nname='r'\nat=0\nignore=true\n";
  const RuleBook book(
      rules_of("[[frame]]\nname='a'\nkind='idle'\nidle_ms=5\nlongest=10\n"
               "[[frame]]\nname='b'\nkind='idle'\nidle_ms=2\nlongest=30\n"
               "[[frame]]\nname='c'\nkind='idle'\nidle_ms=9\nlongest=20\n" +
               rule));
  EXPECT_EQ(book.longest(), 30U);
  EXPECT_EQ(book.idle(), Micros(2000));
  EXPECT_EQ(book_of("at=0\nignore=true\n").idle(), Micros::max());
  RuleSet none;
  EXPECT_EQ(RuleBook(none).longest(), 1U);
  EXPECT_EQ(name_of(book.set(), Rule{.name = "x"}), "rule 'x'");
}

// The replies alone, told what came by hand.
class RuleRepliesAlone : public testing::Test {
 protected:
  RuleRepliesAlone() { replies.begin(); }
  void asked(std::string_view recorded, std::string_view came) {
    replies.asked({offset, as_bytes(recorded), as_bytes(came)});
    offset += recorded.size();
  }
  std::string answer(std::string_view bytes) {
    return std::string(as_text(replies.answer({as_bytes(bytes), 0, offset})));
  }
  std::string rest() { return std::string(as_text(replies.rest())); }

  RuleReplies replies{std::make_shared<const RuleBook>(rules_of(
      std::string(kBookLine) +
      "[[rule]]\nname='t'\ncapture='T(\\d)'\nregex='\\d'\n[[rule]]\nname='k'\nwhen='^keep'\nrepeated=true\n"
      "[[reply]]\nname='t'\nwhen='^T'\nfrom={at=1,size=1}\nto={at=1,size=1}\n"))};
  std::uint64_t offset = 0;
};

TEST_F(RuleRepliesAlone, ARequestMayComeInPieces) {
  asked("T1\n", "T");
  asked("", "7\n");
  EXPECT_EQ(answer("A1\n"), "A7\n");
}

TEST_F(RuleRepliesAlone, APieceOfAnAnswerIsKeptUntilItsFrameIsWhole) {
  asked("T1\n", "T7\n");
  EXPECT_EQ(answer("A"), "");
  EXPECT_TRUE(replies.keeps());
  EXPECT_EQ(answer("1\nB1"), "A7\n");
  EXPECT_EQ(rest(), "B1");
  EXPECT_FALSE(replies.keeps());
}

TEST_F(RuleRepliesAlone, WhatNoReplyIsAboutPassesAsItComes) {
  asked("X1\n", "X1\n");
  EXPECT_EQ(answer("A"), "A") << "whole or not";
  EXPECT_FALSE(replies.keeps());
  EXPECT_EQ(answer("1\nB"), "1\nB");
}

TEST_F(RuleRepliesAlone, ARequestThatWasLeftOutIsNoRequest) {
  asked("T1\nT2\n", "T8\nxx\n");
  EXPECT_EQ(answer("A1\n"), "A8\n") << "the latest that came";
  asked("T3\n", "");
  EXPECT_EQ(answer("A1\n"), "A1\n");
}

TEST_F(RuleRepliesAlone, WhatComesInThePlaceOfOneThatWasLeftOutIsTheNextRequest) {
  asked("x\nT1\n", "T8\n");
  EXPECT_EQ(answer("A1\n"), "A8\n");
}

TEST_F(RuleRepliesAlone, ManyFramesMayComeAtOnce) {
  asked("a\nb\nc\nT1\n", "a\nb\nc\nT7\n");
  EXPECT_EQ(answer("A1\n"), "A7\n");
}

TEST_F(RuleRepliesAlone, WhatMayBeRepeatedIsNotTakenForARequest) {
  asked("T1\n", "keep\nT7\n");
  EXPECT_EQ(answer("A1\n"), "A7\n");
}

TEST_F(RuleRepliesAlone, ARequestIsOfItsOwnAnswerAlone) {
  asked("T1\n", "T7\n");
  EXPECT_EQ(answer("A1\n"), "A7\n");
  asked("x\n", "x\n");
  EXPECT_EQ(answer("A1\n"), "A1\n");
}

TEST_F(RuleRepliesAlone, AnotherPlaceOnTheTapeBeginsAnew) {
  asked("T", "T");
  offset = 100;
  asked("T1\n", "T5\n");
  EXPECT_EQ(answer("A1\n"), "A5\n");
}

TEST_F(RuleRepliesAlone, ARequestCountsAlthoughTheTapeGoesOnElsewhere) {
  asked("T1\n", "T7\n");
  offset += 100;
  asked("x\n", "x\n");
  EXPECT_EQ(answer("A1\n"), "A7\n");
}

TEST_F(RuleRepliesAlone, ABeginForgetsAll) {
  asked("T1\n", "T7\n");
  EXPECT_EQ(answer("A"), "");
  replies.begin();
  EXPECT_FALSE(replies.keeps());
  offset = 0;
  EXPECT_EQ(answer("A1\n"), "A1\n");
}

}  // namespace
}  // namespace porttape::test
