#include "libport/rules/rule_expectation.hpp"

#include <string>

#include <gtest/gtest.h>

#include "tests/rules/rules_rig.hpp"

namespace porttape::test {
namespace {

using namespace std::string_literals;

constexpr std::string_view kLines = R"(
[[frame]]
name = 'line'
kind = 'delimited'
end = "\n"
)";

class RuleExpectationTest : public ::testing::Test {
 protected:
  // `rules` behind the format of lines.
  Outcome lines(const MemoryTape& tape, std::string_view rules, std::string_view text) {
    return with(tape, std::string(kLines) + std::string(rules), text);
  }
  Outcome with(const MemoryTape& tape, const std::string& rules, std::string_view text) {
    const RuleExpectation expectation(rules_of(rules));
    return play_cut(tape, expectation, text);
  }
};

TEST_F(RuleExpectationTest, BytesMayBeIgnoredAndTheRestIsComparedByteByByte) {
  const auto tape = MemoryTape().write(0, "SET 1234 now\nGO\n").read(10, "ok");
  constexpr std::string_view rule = "[[rule]]\nname='n'\nwhen='^SET'\nat=4\nsize=4\nignore=true";
  EXPECT_EQ(lines(tape, rule, "SET abcd now\nGO\n"), (Outcome{.answers = "ok"}));
  EXPECT_EQ(lines(tape, rule, "SET abcd not\nGO\n").offset, 11U);
  EXPECT_EQ(lines(tape, rule, "SET abcd now\nGX\n").offset, 14U);
  EXPECT_EQ(lines(tape, rule, "SET abcd now\n").verdict, Verdict::incomplete);
  EXPECT_EQ(lines(tape, rule, "SET abcd now\nGO\n!").verdict, Verdict::extra);
  EXPECT_EQ(lines(tape, rule, "SIT abcd now\nGO\n").offset, 1U);
}

TEST_F(RuleExpectationTest, AMaskFreesSomeBits) {
  const auto tape = MemoryTape().write(0, "a\x10z\n"s);
  constexpr std::string_view rule = "[[rule]]\nname='n'\nat=1\nsize=1\nmask='F0'";
  EXPECT_EQ(lines(tape, rule, "a\x1fz\n"s).verdict, Verdict::pass);
  const Outcome wrong = lines(tape, rule, "a\x2fz\n"s);
  EXPECT_EQ(wrong.offset, 1U);
  EXPECT_EQ(wrong.why, R"(rule 'n' (my.rules:6): "/"  2f differs from 10 in bits of the mask)");
}

TEST_F(RuleExpectationTest, AnExpressionMayLetTheLengthVary) {
  const auto tape = MemoryTape().write(0, "T=123;Q\n").read(10, "ok").write(20, "T=4;Q\n").read(30, "on");
  constexpr std::string_view rule = "[[rule]]\nname='t'\ncapture='T=([^;]*);'\nregex='[0-9]+'\nlength=[1, 8]";
  EXPECT_EQ(lines(tape, rule, "T=9;Q\nT=17000000;Q\n"), (Outcome{.answers = "okon"}));
  EXPECT_EQ(lines(tape, rule, "T=9;R\n").offset, 4U);
  EXPECT_EQ(lines(tape, rule, "T=9x;Q\n").offset, 2U);
  EXPECT_EQ(lines(tape, rule, "T=123456789;Q\n").why,
            "rule 't' (my.rules:6): \"123456789\"  313233343536373839 has 9 bytes; accepted: 1 to 8");
  EXPECT_EQ(lines(tape, rule, "T=;Q\n").offset, 2U);
  EXPECT_EQ(lines(MemoryTape().write(0, "T=x;Q\n"), rule, "T=x;Q\n").verdict, Verdict::pass) << "as recorded";
  EXPECT_EQ(lines(tape, rule, "T=1;Q").verdict, Verdict::data_mismatch) << "cut off at the end";
}

TEST_F(RuleExpectationTest, ARangeOfNumbersInTextAndInBytes) {
  const auto tape = MemoryTape().write(0, "P,12.5,x\n");
  constexpr std::string_view rule =
      "[[rule]]\nname='p'\ncolumn=1\nrange=[-1, 90.5]\ntype='decimal'\nlength=[1, 8]";
  EXPECT_EQ(lines(tape, rule, "P,-0.25,x\n").verdict, Verdict::pass);
  EXPECT_EQ(lines(tape, rule, "P,91,x\n").offset, 2U);
  EXPECT_EQ(lines(tape, rule, "P,ten,x\n").why, "rule 'p' (my.rules:6): \"ten\"  74656e is no number");
  const auto bytes = MemoryTape().write(0, "\x01\xff\xfe\n"s);
  constexpr std::string_view signed_rule = "[[rule]]\nname='s'\nat=1\nsize=2\nrange=[-5, 5]\ntype='signed'";
  EXPECT_EQ(lines(bytes, signed_rule, "\x01\xff\xfb\n"s).verdict, Verdict::pass);
  EXPECT_EQ(lines(bytes, signed_rule, "\x01\xff\xfa\n"s).offset, 1U);
}

TEST_F(RuleExpectationTest, ACounterGoesOnFromWhateverItBeginsWith) {
  const auto tape = MemoryTape().write(0,
                                       "#\x01"
                                       "a\n#\x02"
                                       "b\n#\x04"
                                       "c\n"s);
  constexpr std::string_view rule = "[[rule]]\nname='c'\nat=1\nsize=1\ncounter=true";
  EXPECT_EQ(lines(tape, rule,
                  "#\xfe"
                  "a\n#\xff"
                  "b\n#\x01"
                  "c\n"s)
                .verdict,
            Verdict::pass);
  const Outcome wrong = lines(tape, rule,
                              "#\xfe"
                              "a\n#\xfe"
                              "b\n"s);
  EXPECT_EQ(wrong.offset, 5U);
  EXPECT_EQ(wrong.why, "rule 'c' (my.rules:6): \"\\xfe\"  fe is 254 after 254; due: 255");
}

TEST_F(RuleExpectationTest, ACounterInTextMayGrow) {
  const auto tape = MemoryTape().write(0, "n=9;\nn=10;\n");
  constexpr std::string_view rule =
      "[[rule]]\nname='c'\ncapture='n=(\\d+)'\ncounter=true\ntype='decimal'\nlength=[1,9]";
  EXPECT_EQ(lines(tape, rule, "n=99;\nn=100;\n").verdict, Verdict::pass);
  EXPECT_EQ(lines(tape, rule, "n=99;\nn=101;\n").verdict, Verdict::data_mismatch);
  constexpr std::string_view modulo =
      "[[rule]]\nname='c'\ncapture='n=(\\d+)'\ncounter={modulo=100}\ntype='decimal'\nlength=[1,9]";
  EXPECT_EQ(lines(tape, modulo, "n=99;\nn=0;\n").verdict, Verdict::pass);
}

TEST_F(RuleExpectationTest, TheChecksumOfWhatMayVaryIsComputedAnew) {
  const auto tape = MemoryTape().write(0, "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n").read(5, "ok");
  const std::string rules = "[[frame]]\nprotocol='nmea'\n[[rule]]\nname='t'\ncolumn=5\nregex='\\d{6}'\n";
  EXPECT_EQ(with(tape, rules, "$GPGLL,5057.970,N,00146.110,E,142452,A*24\r\n").answers, "ok");
  EXPECT_EQ(with(tape, rules, "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n").answers, "ok");
  const Outcome wrong = with(tape, rules, "$GPGLL,5057.970,N,00146.110,E,142452,A*27\r\n");
  EXPECT_EQ(wrong.offset, 39U);
  EXPECT_EQ(wrong.why, "the checksum XOR is 27 and should be 24");
  EXPECT_EQ(with(tape, rules, "$GPGLL,5057.971,N,00146.110,E,142451,A*26\r\n").offset, 14U);
}

TEST_F(RuleExpectationTest, AChecksumThatDoesNotHoldOnTheTapeIsComparedAsItStands) {
  const auto tape = MemoryTape().write(0, "$A,1*FF\r\n");
  const std::string rules = "[[frame]]\nprotocol='nmea'\n[[rule]]\nname='t'\ncolumn=1\nignore=true\n";
  EXPECT_EQ(with(tape, rules, "$A,2*FF\r\n").verdict, Verdict::pass);
  EXPECT_EQ(with(tape, rules, "$A,2*5F\r\n").offset, 5U);
}

TEST_F(RuleExpectationTest, ALengthFollowsWhatVaries) {
  const auto tape = MemoryTape().write(0, "\x7e\x03xyz!\x7e\x01q!"s);
  const std::string rules =
      "[[frame]]\nname='f'\nkind='length'\nstart_hex='7e'\nlength={at=1,size=1,adds=3}\n"
      "[[rule]]\nname='p'\nwhen='xyz'\nat=2\nto=-1\nignore=true\nlength=[0,9]\n";
  EXPECT_EQ(with(tape, rules, "\x7e\x05hello!\x7e\x01q!"s).verdict, Verdict::pass);
  EXPECT_EQ(with(tape, rules, "\x7e\x00!\x7e\x01q!"s).verdict, Verdict::pass);
  EXPECT_EQ(with(tape, rules, "\x7e\x05hello?\x7e\x01q!"s).offset, 7U);
  EXPECT_EQ(with(tape, rules, "\x7e\x0ahelloworld!"s).offset, 2U) << "longer than it may be";
  EXPECT_EQ(with(tape, rules, "\x7e\x03xyz!\x7e\x02q!!"s).offset, 7U) << "no rule is about this one";
}

TEST_F(RuleExpectationTest, FramesMayBeLeftOut) {
  const auto tape = MemoryTape().write(0, "PING\n").write(1, "GO 1\n").read(10, "ok").write(20, "OO\n");
  constexpr std::string_view rule = "[[rule]]\nname='o'\nwhen='^(PING|OO)'\noptional=true";
  for (const std::string_view text : {"PING\nGO 1\nOO\n", "GO 1\nOO\n", "PING\nGO 1\n", "GO 1\n"})
    EXPECT_EQ(lines(tape, rule, text), (Outcome{.answers = "ok"})) << text;
  EXPECT_EQ(lines(tape, rule, "GO 2\n").offset, 3U);
  EXPECT_EQ(lines(tape, rule, "PONG\nGO 1\n").verdict, Verdict::data_mismatch);
  EXPECT_EQ(lines(tape, rule, "GO 1\nOX\n").verdict, Verdict::extra);
  EXPECT_EQ(lines(tape, rule, "PING\n").verdict, Verdict::incomplete);
}

TEST_F(RuleExpectationTest, WithAFrameItsAnswerMayBeLeftOut) {
  const auto tape = MemoryTape()
                        .write(0, "Q0\n")
                        .read(5, "A0")
                        .write(10, "Q1\n")
                        .read(15, "A")
                        .read(16, "1")
                        .write(20, "Q2\n")
                        .read(25, "A2")
                        .write(30, "Q3\n")
                        .read(35, "A3");
  const std::string rule = "[[rule]]\nname='o'\nwhen='^Q[12]'\noptional=true\n";
  for (const auto& [key, answers, doubts] : {std::tuple("", "A0A1A2A3", 1U),
                                             {"with_answer=false", "A0A1A2A3", 0U},
                                             {"with_answer=true", "A0A3", 0U}}) {
    const RuleExpectation rules(rules_of(std::string(kLines) + rule + key));
    for (const std::size_t piece : {1U, 100U}) {
      Rig rig(tape, {.on_mismatch = OnMismatch::fail}, true, piece, {.expectation = &rules});
      rig.open().write("Q0\n").wait(100'000).write("Q3\n").wait(10'000'000);
      EXPECT_EQ(rig.finish_unless_ended(), Verdict::pass) << key;
      EXPECT_EQ(rig.read(), answers) << key;
      EXPECT_EQ(rig.report->doubts.size(), doubts) << key;
    }
    EXPECT_EQ(play_cut(tape, rules, "Q0\nQ1\nQ2\nQ3\n").answers, "A0A1A2A3") << "what came is answered";
    EXPECT_EQ(play_cut(tape, rules, "Q0\nQ2\nQ3\n").verdict, Verdict::pass);
  }
  EXPECT_EQ(lines(tape, rule + "with_answer=true", "Q0\nQ2\nQ3\n").answers, "A0A2A3");
}

TEST_F(RuleExpectationTest, AFrameOfOneFormatMayComeWhereOneOfAnotherIsLeftOut) {
  const auto tape = MemoryTape().write(0, "PING\n").write(1, "\x7e\x02\x0a").write(2, "GO\n").read(10, "ok");
  const std::string rules = "[[frame]]\nname='packet'\nkind='fixed'\nstart='~'\nsize=3\n" +
                            std::string(kLines) +
                            "[[rule]]\nname='o'\nwhen='^PING'\noptional=true\nrepeated=true\n";
  EXPECT_EQ(with(tape, rules, "\x7e\x02\x0aGO\n").answers, "ok");
  EXPECT_EQ(with(tape, rules, "\x7e\x02\x0aPING\nGO\nPING\n").answers, "ok");
  EXPECT_EQ(with(tape, rules, "\x7e\x02\x0bGO\n").verdict, Verdict::data_mismatch);
}

TEST_F(RuleExpectationTest, TheLastBytesOfASessionMayBeLeftOut) {
  const auto tape = MemoryTape().write(0, "end\n").read(10, "ok").write(20, "OO");
  const std::string rules =
      "[[frame]]\nname='over'\nkind='fixed'\nstart='OO'\nsize=2\n"
      "[[rule]]\nname='o'\nframe='over'\noptional=true\n";
  EXPECT_EQ(with(tape, rules, "end\nOO").verdict, Verdict::pass);
  EXPECT_EQ(with(tape, rules, "end\n").verdict, Verdict::pass);
}

TEST_F(RuleExpectationTest, FramesMayBeRepeated) {
  const auto tape = MemoryTape().write(0, "A\n").read(10, "x").write(20, "B\n").read(30, "y");
  constexpr std::string_view rule = "[[rule]]\nname='p'\nwhen='^PING \\d+'\nrepeated=true";
  for (const std::string_view text : {"A\nB\n", "PING 1\nA\nPING 2\nPING 3\nB\nPING 4\n"})
    EXPECT_EQ(lines(tape, rule, text), (Outcome{.answers = "xy"})) << text;
  EXPECT_EQ(lines(tape, rule, "A\nB\nPONG\n").verdict, Verdict::extra);
  EXPECT_EQ(lines(tape, rule, "A\nB\nPING").verdict, Verdict::extra) << "cut off";
  EXPECT_EQ(lines(tape, rule, "PING 1\nA\nPONG\n").offset, 9U);
}

TEST_F(RuleExpectationTest, IdleFramesEndWithThePause) {
  const auto tape = MemoryTape()
                        .write(0, "\x01\x03\x00\x00\x00\x0a\xc5\xcd"s)
                        .read(5'000, "ok")
                        .write(9'000, "\x01\x03\x00\x01\x00\x0a\x94\x0d"s);
  const RuleExpectation rules(
      rules_of("[[frame]]\nprotocol='modbus-rtu'\n[[rule]]\nname='a'\nat=2\nsize=2\nignore=true\n"));
  for (const std::size_t cut : {1U, 3U, 8U}) {
    const Outcome right =
        play(tape, rules, "\x01\x03\x00\x01\x00\x0a\x94\x0d\x01\x03\x00\x01\x00\x0a\x94\x0d"s, cut, 100);
    EXPECT_EQ(right, (Outcome{.answers = "ok"})) << cut;
    const Outcome wrong = play(tape, rules, "\x01\x03\x00\x01\x00\x0a\xc5\xcd"s, cut, 100);
    EXPECT_EQ(wrong.offset, 6U);
    EXPECT_EQ(wrong.why, "the checksum CRC-16/MODBUS is c5cd and should be 940d");
  }
}

TEST_F(RuleExpectationTest, AnIdleFrameMayBeLongerOrShorter) {
  const auto tape = MemoryTape().write(0, "ab12").read(5'000, "ok").write(9'000, "ab345").read(9'100, "on");
  const RuleExpectation rules(rules_of(
      "[[frame]]\nname='i'\nkind='idle'\nidle_ms=2\n[[rule]]\nname='n'\nat=2\nregex='\\d+'\nlength=[1,5]\n"));
  for (const std::size_t size : {std::size_t{1}, std::size_t{5}}) {
    Rig rig(tape, {.on_mismatch = OnMismatch::fail}, true, 100, {.expectation = &rules});
    const std::string number(size, '7');
    rig.open().write("ab" + number).wait(5'000);
    EXPECT_EQ(rig.read(), "ok");
    rig.write("ab").write(number).wait(600);
    EXPECT_EQ(rig.read(), "on");
    EXPECT_EQ(rig.finish(), Verdict::pass);
  }
}

TEST_F(RuleExpectationTest, FramesOfSeveralFormatsShareALine) {
  const auto tape = MemoryTape().write(0, "\xb5\x62\x0a\x04\x00\x00\x0e\x34$A,1*5C\r\n+-+"s);
  const std::string rules =
      "[[frame]]\nprotocol='ubx'\n[[frame]]\nprotocol='nmea'\n"
      "[[rule]]\nname='v'\nframe='ubx'\nat=3\nsize=1\nignore=true\n"
      "[[rule]]\nname='n'\nframe='nmea'\ncolumn=1\nignore=true\n";
  EXPECT_EQ(with(tape, rules, "\xb5\x62\x0a\x05\x00\x00\x0f\x37$A,2*5F\r\n+-+"s).verdict, Verdict::pass);
  EXPECT_EQ(with(tape, rules, "\xb5\x62\x0a\x05\x00\x00\x0f\x37$A,2*5F\r\n++"s).offset, 18U);
}

TEST_F(RuleExpectationTest, HostileBytesTakeLinearTime) {
  const std::string long_line = std::string(4000, 'a') + "\n";
  const auto tape = MemoryTape().write(0, long_line);
  const std::string rules =
      std::string(kLines) + "[[rule]]\nname='r'\nat=0\nto=-1\nregex='(a|aa)*b'\nlength=[0,4096]\n";
  const RuleExpectation expectation(rules_of(rules));
  EXPECT_EQ(play(tape, expectation, long_line.substr(1), 5000, 5000).verdict, Verdict::data_mismatch);
}

TEST_F(RuleExpectationTest, WhatCameOfAFrameThatIsJudgedWholeIsInTheReport) {
  const auto tape = MemoryTape().write(0, "PING 1\n").read(10, "x").write(20, "GO\n").read(30, "y");
  const RuleExpectation rules(
      rules_of(std::string(kLines) + "[[rule]]\nname='p'\nwhen='^PING'\nrepeated=true\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::fail}, true, 100, {.expectation = &rules});
  rig.open().write("X\n");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(as_text(rig.report->mismatch->got), "X\n");
  EXPECT_EQ(as_text(rig.report->mismatch->came), "X\n");
}

// A poll that may be left out is one request, and what is left out where another comes is not that.
TEST_F(RuleExpectationTest, UnderLookupAnOptionalRequestStandsForNoOther) {
  const auto tape = MemoryTape().write(0, "PING 1\n").read(10, "p").write(20, "GO\n").read(30, "g");
  const RuleExpectation rules(
      rules_of(std::string(kLines) + "[[rule]]\nname='p'\nwhen='^PING'\noptional=true\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::fail, .match = Match::lookup}, true, 100,
          {.expectation = &rules});
  rig.open();
  EXPECT_EQ(rig.write("GO\n").wait(1'000).read(), "g");
  EXPECT_EQ(rig.write("PING 1\n").wait(1'000).read(), "p");
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->requests, 2U);
}

TEST_F(RuleExpectationTest, UnderLookupARequestMayEndWithAFrameThatIsLeftOut) {
  const auto tape = MemoryTape().write(0, "GO\nOO\n").read(10, "g").write(20, "END\n").read(30, "e");
  const RuleExpectation rules(
      rules_of(std::string(kLines) + "[[rule]]\nname='o'\nwhen='^OO'\noptional=true\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::fail, .match = Match::lookup}, true, 100,
          {.expectation = &rules});
  rig.open();
  EXPECT_EQ(rig.write("GO\nEND\n").wait(1'000).read(), "ge");
  EXPECT_EQ(rig.write("GO\nOO\n").wait(1'000).read(), "g");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST_F(RuleExpectationTest, UnderLookupARequestMayBeWrittenInPieces) {
  const auto tape =
      MemoryTape().write(0, "T=").write(100, "1\n").read(200, "a").write(300, "T=2\n").read(400, "b");
  const RuleExpectation rules(
      rules_of(std::string(kLines) + "[[rule]]\nname='t'\nat=2\nsize=1\nregex='\\d'\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::fail, .match = Match::lookup}, true, 100,
          {.expectation = &rules});
  rig.open();
  EXPECT_EQ(rig.write("T=7\n").wait(1'000).read(), "a");
  EXPECT_EQ(rig.write("T=").write("8\n").wait(1'000).read(), "b");
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->requests, 1U) << "the number may be any";
}

TEST_F(RuleExpectationTest, UnderLookupAFrameThatMayBeRepeatedMayBeTheLast) {
  const auto tape = MemoryTape().write(0, "PING 1\n").read(10, "p").write(20, "GO\n").read(30, "g");
  const RuleExpectation rules(
      rules_of(std::string(kLines) + "[[rule]]\nname='p'\nwhen='^PING'\nrepeated=true\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::fail, .match = Match::lookup}, true, 100,
          {.expectation = &rules});
  rig.open();
  EXPECT_EQ(rig.write("GO\n").wait(1'000).read(), "g");
  EXPECT_EQ(rig.write("PING 2\n").wait(1'000).read(), "");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST_F(RuleExpectationTest, UnderWarnWhatAPauseShowsIsToldOnceForItsExchange) {
  const auto tape = MemoryTape().write(0, "ab12").read(5'000, "ok").write(9'000, "ab34").read(9'100, "on");
  const RuleExpectation rules(rules_of(
      "[[frame]]\nname='i'\nkind='idle'\nidle_ms=2\n[[rule]]\nname='n'\nat=2\nregex='\\d+'\nlength=[1,5]\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::warn}, true, 100, {.expectation = &rules});
  rig.open().write("abxy");
  EXPECT_EQ(rig.mismatches.size(), 0U);
  rig.wait(3'000);
  EXPECT_EQ(rig.mismatches.size(), 1U);
  rig.write("more").wait(3'000).write("ab12").wait(3'000);
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.finish(), Verdict::data_mismatch);
}

TEST_F(RuleExpectationTest, UnderWarnTheNextExchangeIsComparedAgain) {
  const auto tape = MemoryTape().write(0, "N=1\n").read(10, "x").write(20, "N=2\n").read(30, "y");
  const RuleExpectation rules(
      rules_of(std::string(kLines) + "[[rule]]\nname='n'\nat=2\nto=-1\nregex='\\d+'\nlength=[1,3]\n"));
  Rig rig(tape, {.on_mismatch = OnMismatch::warn}, true, 100, {.expectation = &rules});
  rig.open().write("N=x\n").wait(200'000).write("N=17\n").wait(200'000);
  EXPECT_EQ(rig.read(), "xy");
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.finish(), Verdict::data_mismatch);
}

}  // namespace
}  // namespace porttape::test
