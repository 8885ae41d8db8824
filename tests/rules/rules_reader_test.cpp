#include "libport/rules/rules_reader.hpp"

#include <fmt/format.h>
#include <optional>
#include <string>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

std::string refused(std::string_view text) {
  const Result<RuleSet> rules = read_rules(text, "my.rules");
  EXPECT_FALSE(rules) << "accepted: " << text;
  if (rules) return {};
  EXPECT_EQ(rules.error().code, Errc::usage);
  return rules.error().message;
}

constexpr std::string_view kAll = R"(
format = 'porttape-rules'
version = 1

[[frame]]
protocol = 'nmea'

[[frame]]
name = 'packet'
kind = 'length'
start_hex = 'AA 55'
length = { at = 2, size = 2, order = 'little', adds = 6 }
longest = 512
checksum = { kind = 'crc-16/modbus', at = -2, from = 2, order = 'little' }

[[frame]]
name = 'block'
kind = 'fixed'
start = '#'
size = 8

[[frame]]
name = 'rest'
kind = 'idle'
idle_ms = 2.5

[[rule]]
name = 'time'
frame = 'nmea'
when = '^\$GPRMC'
column = 1
regex = '\d{6}'

[[rule]]
name = 'sequence'
frame = 'packet'
at = 4
size = 2
counter = { modulo = 1000 }
order = 'little'

[[rule]]
name = 'angle'
frame = 'block'
at = 1
to = -2
range = [0, 359.5]
type = 'decimal'
length = [1, 5]

[[rule]]
name = 'flags'
at = -2
size = 1
mask = '0F'

[[rule]]
name = 'poll'
when = "^\u0005'"
optional = true
repeated = true

[[reply]]
name = 'sequence'
frame = 'packet'
from = { at = 4, size = 2 }
answer_frame = 'packet'
answer = '^\xAA'
to = { capture = '^\xAA(..)' }
)";

TEST(RulesReaderTest, ReadsEveryKey) {
  const Result<RuleSet> rules = read_rules(kAll, "my.rules");
  ASSERT_TRUE(rules) << rules.error().message;
  ASSERT_EQ(rules->frames.size(), 5U);
  EXPECT_EQ(rules->frames[1].start, (Bytes{'!'}));
  const FrameFormat& packet = rules->frames[2];
  EXPECT_EQ(packet.start, (Bytes{0xaa, 0x55}));
  EXPECT_EQ(packet.length, (LengthField{.at = 2, .size = 2, .order = ByteOrder::little, .adds = 6}));
  EXPECT_EQ(packet.checksum,
            (ChecksumField{.kind = "CRC-16/MODBUS", .at = -2, .from = 2, .order = ByteOrder::little}));
  EXPECT_EQ(rules->frames[4].idle, Micros{2'500});
  ASSERT_EQ(rules->rules.size(), 5U);
  EXPECT_EQ(rules->rules[0].place, (Place{.by = Place::By::column, .column = 1}));
  EXPECT_EQ(rules->rules[0].line.number, 27);
  EXPECT_EQ(rules->rules[1].counter.modulo, 1000U);
  EXPECT_EQ(rules->rules[2].length, (Rule::Length{1, 5}));
  EXPECT_TRUE(rules->rules[4].optional && rules->rules[4].repeated);
  EXPECT_EQ(rules->replies.front().to.capture, "^\\xAA(..)");
}

TEST(RulesReaderTest, WhatIsLeftOutIsAsTheDocumentSays) {
  const Result<RuleSet> rules = read_rules(
      "[[frame]]\nname='a'\nkind='length'\nlength={at=3}\nchecksum={kind='CRC-16/MODBUS'}\n"
      "[[frame]]\nname='b'\nkind='delimited'\nend='x'\nchecksum={kind='CRC-16/MODBUS',hex=true}\n"
      "[[frame]]\nname='c'\nkind='fixed'\nsize=5000\n"
      "[[frame]]\nprotocol='nmea'\nlongest=80\n"
      "[[frame]]\nprotocol='ubx'\nname='d'\n"
      "[[rule]]\nname='r'\ncolumn=0\ncounter=true\n"
      "[[redact]]\nname='s'\npattern='x'\n",
      "my.rules");
  ASSERT_TRUE(rules) << rules.error().message;
  ASSERT_EQ(rules->frames.size(), 6U);
  EXPECT_EQ(rules->frames[0].length, (LengthField{.at = 3, .size = 1, .order = ByteOrder::big, .adds = 0}));
  EXPECT_EQ(rules->frames[0].checksum, (ChecksumField{.kind = "CRC-16/MODBUS", .at = -2, .from = 0}));
  EXPECT_EQ(rules->frames[0].longest, 4096U);
  EXPECT_EQ(rules->frames[0].start, Bytes());
  EXPECT_EQ(rules->frames[1].checksum->at, -4) << "two digits a byte";
  EXPECT_EQ(rules->frames[1].trailer, 0U);
  EXPECT_EQ(rules->frames[2].longest, 5000U) << "a frame of a fixed size is never too long";
  EXPECT_EQ(rules->frames[3].longest, 80U);
  EXPECT_EQ(rules->frames[4].longest, 80U);
  EXPECT_EQ(rules->frames[3].name, "nmea");
  EXPECT_EQ(rules->frames[5].name, "d");
  EXPECT_EQ(rules->frames[5].protocol, "ubx");
  EXPECT_EQ(rules->frames[5].longest, 4096U);
  EXPECT_EQ(rules->rules[0].place, (Place{.by = Place::By::column, .at = 0, .column = 0, .separator = ","}));
  EXPECT_EQ(rules->rules[0].counter.modulo, 0U);
  EXPECT_EQ(rules->rules[0].type, NumberType::unsigned_);
  EXPECT_EQ(rules->rules[0].order, ByteOrder::big);
  EXPECT_FALSE(rules->rules[0].optional || rules->rules[0].repeated);
  EXPECT_EQ(rules->rules[0].with_answer, std::nullopt);
  EXPECT_EQ(rules->redactions[0].longest, 1024U);
  EXPECT_EQ(rules->redactions[0].filler, FillerKind::like);
  EXPECT_TRUE(rules->redactions[0].events);
  EXPECT_EQ(rules->redactions[0].direction, std::nullopt);
}

TEST(RulesReaderTest, WhatIsWrittenIsReadAsTheSame) {
  const Result<RuleSet> rules = read_rules(kAll, "my.rules");
  ASSERT_TRUE(rules);
  const std::string text = to_toml(*rules);
  const Result<RuleSet> again = read_rules(text, "again.rules");
  ASSERT_TRUE(again) << again.error().message << '\n' << text;
  EXPECT_EQ(*again, *rules) << text;
  EXPECT_EQ(to_toml(*again), text);
}

TEST(RulesReaderTest, ManyMistakesAreToldAtOnceWithLineAndKey) {
  EXPECT_EQ(refused("[[frame]]\nname = 'f'\nkind = 'delimted'\n\n[[rule]]\nname = 'a'\nframe = 'g'\nat = "
                    "1\nregexp = 'x'\n"),
            "my.rules:3: key 'kind' of [[frame]] 'f' is 'delimted'; accepted: delimited, length, fixed, "
            "idle; did you "
            "mean 'delimited'?\n"
            "my.rules:5: [[rule]] 'a' needs one of ignore, mask, regex, range, counter, optional, repeated: "
            "how the "
            "bytes may vary\n"
            "my.rules:7: key 'frame' of [[rule]] 'a' is 'g', and there is no [[frame]] of that name\n"
            "my.rules:9: [[rule]] 'a' has no key 'regexp'; did you mean 'regex'?");
}

TEST(RulesReaderTest, EachMistakeIsNamed) {
  constexpr std::string_view frame = "[[frame]]\nname='f'\nkind='delimited'\nend='x'\n";
  const auto rule = [&](std::string_view keys) {
    return refused(std::string(frame) + "[[rule]]\nname='r'\n" + std::string(keys));
  };
  const auto has = [](const std::string& message, std::string_view part) {
    EXPECT_NE(message.find(part), std::string::npos) << message;
  };
  has(refused(""), "has neither a [[rule]] nor a [[reply]]");
  has(refused("x = = 1"), "my.rules:1: this is no TOML");
  has(refused("format='other'\n"), "accepted: 'porttape-rules'");
  has(refused("version=2\n"), "key 'version' of the file is 2");
  has(refused("rule='x'\n"), "accepted: [[rule]]");
  has(refused("rules=1\n"), "the file has no key 'rules'; did you mean 'rule'?");
  has(rule("at=0\nregex='a('\n"),
      "my.rules:8: key 'regex' of [[rule]] 'r' is no regular expression: missing )");
  has(rule("when='*'\nat=0\nignore=true\n"), "key 'when'");
  has(rule("capture='abc'\nignore=true\n"), "has no group in parentheses");
  has(rule("at=0\ncolumn=1\nignore=true\n"), "needs one of at, column, capture");
  has(rule("at=0\nsize=2\nto=3\nignore=true\n"), "besides 'size'");
  for (const std::string_view place : {"column=1\n", "capture='a(b)'\n"}) {
    for (const std::string_view key : {"size", "to"})
      has(rule(fmt::format("{}{}=3\nignore=true\n", place, key)),
          fmt::format("key '{}' of [[rule]] 'r' has no meaning here: it belongs to 'at'", key));
  }
  for (const std::string_view place : {"at=1\n", "capture='a(b)'\n"})
    has(rule(fmt::format("{}separator=';'\nignore=true\n", place)), "it belongs to 'column'");
  has(refused(std::string(frame) + "[[redact]]\nname='r'\ncolumn=2\nsize=4\n"), "it belongs to 'at'");
  has(rule("at=5\nto=3\nignore=true\n"), "a position behind it");
  has(rule("at=-2\nsize=3\nignore=true\n"), "to the frame's end there are 2");
  has(rule("at=0\nsize=9\ncounter=true\n"), "up to 8 bytes");
  has(rule("at=99999\nignore=true\n"), "accepted: a whole number from -65535 to 65535");
  has(rule("at=0\nrange=[5,1]\n"), "the smaller number first");
  has(rule("at=0\nrange=5\n"), "two numbers");
  has(rule("at=0\nsize=2\nmask='FF'\n"), "has 1 bytes, and the place has 2");
  has(rule("at=0\nmask='F'\n"), "two hexadecimal digits");
  has(rule("at=0\nsize=1\nignore=true\nlength=[1,2]\n"), "'to' instead of 'size'");
  has(rule("at=0\nignore=true\nlength=[1.5,2]\n"), "whole numbers of bytes");
  has(rule("at=0\nignore=true\ntype='hex'\n"), "of a range or a counter");
  has(rule("at=0\ncounter=true\ntype='deciml'\n"), "did you mean 'decimal'?");
  has(rule("optional=true\n"), "would let every frame");
  has(rule("frame='f'\noptional=true\nat=1\nignore=true\n"), "accepted: a rule for each");
  has(rule("at=0\nignore=false\n"), "accepted: true");
  has(rule("at=0\nignore='yes'\n"), "is of the kind string");
  has(refused(std::string(frame) +
              "checksum={kind='crc-16/modbuz'}\n[[rule]]\nname='r'\nat=0\nignore=true\n"),
      "no known checksum; RULES.md lists them; did you mean 'CRC-16/MODBUS'?");
  has(refused(std::string(frame) +
              "checksum={kind='CRC-16/MODBUS',at=-1}\n[[rule]]\nname='r'\nat=0\nignore=true\n"),
      "my.rules:5: key 'at' of 'checksum' of [[frame]] 'f' is -1, and the checksum is of 2 bytes");
  has(refused("[[frame]]\nprotocol='nmae'\n[[rule]]\nname='r'\nat=0\nignore=true\n"), "did you mean 'nmea'?");
  has(refused(std::string(frame) + std::string(frame) + "[[rule]]\nname='r'\nat=0\nignore=true\n"),
      "a name of its own");
}

TEST(RulesReaderTest, AnEmptyExpressionIsNoVariation) {
  const Result<RuleSet> rules =
      read_rules("[[frame]]\nprotocol='nmea'\n[[rule]]\nname='t'\nat=1\nregex=''\n", "my.rules");
  ASSERT_FALSE(rules.has_value());
  EXPECT_THAT(rules.error().message, testing::HasSubstr("key 'regex' of [[rule]] 't' is empty"));
}

TEST(RulesReaderTest, AHeaderThatIsNoneIsNamed) {
  using namespace std::string_literals;  // bytes of zero are in them
  for (const std::string& text :
       {"[=]"s, "[[!]]"s, "[\0[frame]]\n"s, "[[frame]\0]\n"s, "\0"s, "a\0 = 1"s, "a = 'b\0c'"s,
        "\xC3\xA4 = 1"s, "a = 1 \xCD\x8C"s, "a = 'b' \xC3\xA4"s, "a = [1,\xC3\xA4]"s}) {
    const Result<RuleSet> rules = read_rules(text, "my.rules");
    ASSERT_FALSE(rules.has_value());
    EXPECT_THAT(rules.error().message, testing::HasSubstr("my.rules:1: this is no TOML: "));
  }
}

TEST(RulesReaderTest, AnyLetterMayStandInTextsAndComments) {
  const std::string name = "\xC3\xA4\xCD\x8C";
  for (const std::string quote : {"'", "\"", "\"\"\"", "\'\'\'"}) {
    const Result<RuleSet> rules =
        read_rules("# '" + name + "\n[[rule]]\nwhen='a'\noptional=true\nname=" + quote + name + quote + '\n',
                   "my.rules");
    ASSERT_TRUE(rules.has_value()) << quote << ": " << rules.error().message;
    EXPECT_EQ(rules->rules.front().name, name);
  }
}

TEST(RulesReaderTest, ACounterWithoutAModuloHasNone) {
  const Result<RuleSet> rules = read_rules("[[rule]]\nname='r'\nat=0\nsize=1\ncounter={}\n", "my.rules");
  ASSERT_TRUE(rules.has_value());
  EXPECT_EQ(rules->rules[0].counter.modulo, 0U);
}

}  // namespace
}  // namespace porttape
