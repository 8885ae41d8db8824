#include "libport/rules/rule_replies.hpp"

#include <string>

#include <gtest/gtest.h>

#include "tests/rules/rules_rig.hpp"

namespace porttape::test {
namespace {

using namespace std::string_literals;

constexpr std::string_view kModbus = R"(
[[frame]]
protocol = 'modbus-tcp'
[[rule]]
name = 'transaction'
at = 0
size = 2
counter = true
[[reply]]
name = 'transaction'
from = { at = 0, size = 2 }
to = { at = 0, size = 2 }
)";

TEST(RuleRepliesTest, AFieldOfTheRequestIsCopiedIntoItsAnswer) {
  const auto request = [](char id) { return "\x00"s + id + "\x00\x00\x00\x06\x01\x03\x00\x00\x00\x01"s; };
  const auto answer = [](char id) { return "\x00"s + id + "\x00\x00\x00\x05\x01\x03\x02\x12\x34"s; };
  const auto tape =
      MemoryTape().write(0, request(1)).read(10, answer(1)).write(20, request(2)).read(30, answer(2));
  const RuleExpectation rules(rules_of(kModbus));
  EXPECT_EQ(play_cut(tape, rules, request(7) + request(8)).answers, answer(7) + answer(8));
  EXPECT_EQ(play_cut(tape, rules, request(1) + request(2)).answers, answer(1) + answer(2));
  EXPECT_EQ(play_cut(tape, rules, request(7) + request(9)).verdict, Verdict::data_mismatch);
}

constexpr std::string_view kLine = R"(
[[frame]]
name = 'line'
kind = 'delimited'
end = "\n"
checksum = { kind = 'XOR', at = -3, to = -3, hex = true }
[[rule]]
name = 'time'
capture = 'T=(\d+);'
regex = '\d+'
length = [1, 9]
[[reply]]
name = 'time'
when = '^GET'
from = { capture = 'T=(\d+);' }
answer = '^GOT'
to = { capture = 'T=(\d+);' }
)";

std::string line(std::string text) {
  Byte sum = 0;
  for (const char character : text) sum ^= static_cast<Byte>(character);
  text += to_hex({&sum, 1});
  return text + "\n";
}

TEST(RuleRepliesTest, TheAnswersLengthAndChecksumFollow) {
  const auto tape = MemoryTape()
                        .write(0, line("GET T=12;"))
                        .read(10, "busy\n" + line("GOT T=12;9"))
                        .write(20, line("SET T=3;"))
                        .read(30, line("GOT T=3;8"));
  const RuleExpectation rules(rules_of(kLine));
  EXPECT_EQ(play_cut(tape, rules, line("GET T=77777;") + line("SET T=5;")).answers,
            "busy\n" + line("GOT T=77777;9") + line("GOT T=3;8"));
}

TEST(RuleRepliesTest, AnAnswerCutOnTheTapeComesWithTheLastByteOfItsFrame) {
  const std::string answer = line("GOT T=12;9");
  auto tape = MemoryTape().write(0, line("GET T=12;"));
  for (std::size_t i = 0; i < answer.size(); ++i)
    tape.read(1'000 * (static_cast<std::int64_t>(i) + 1), answer.substr(i, 1));
  tape.write(50'000, line("END T=1;")).read(51'000, "bye\n");
  const RuleExpectation rules(rules_of(kLine));
  Rig rig(tape, {}, true, 100, {.expectation = &rules});
  rig.open().write(line("GET T=4;")).wait(1'000 * static_cast<std::int64_t>(answer.size()) - 1);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), line("GOT T=4;9"));
  rig.write(line("END T=2;")).wait(1'000);
  EXPECT_EQ(rig.read(), "bye\n");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(RuleRepliesTest, AnAnswerThatIsCutOffComesAllTheSame) {
  const auto tape = MemoryTape().write(0, line("GET T=12;")).read(10, "GOT T=1");
  const RuleExpectation rules(rules_of(kLine));
  EXPECT_EQ(play_cut(tape, rules, line("GET T=5;")).answers, "GOT T=1");
}

TEST(RuleRepliesTest, ADriverThatWritesAheadGetsEachAnswerItsOwn) {
  const auto tape = MemoryTape()
                        .write(0, line("GET T=1;"))
                        .read(10'000, line("GOT T=1;a"))
                        .write(20'000, line("GET T=2;"))
                        .read(30'000, line("GOT T=2;b"));
  const RuleExpectation rules(rules_of(kLine));
  EXPECT_EQ(play_cut(tape, rules, line("GET T=100;") + line("GET T=200;")).answers,
            line("GOT T=100;a") + line("GOT T=200;b"));
}

TEST(RuleRepliesTest, WithoutATemplateThereIsNobodyToAsk) {
  const RuleExpectation rules(
      rules_of("[[frame]]\nprotocol='ubx'\n[[rule]]\nname='v'\nat=3\nsize=1\nignore=true\n"));
  EXPECT_EQ(rules.replies(), nullptr);
}

}  // namespace
}  // namespace porttape::test
