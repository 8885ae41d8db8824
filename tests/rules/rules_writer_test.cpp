#include <fmt/format.h>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/rules/rule_set.hpp"
#include "libport/rules/rules_reader.hpp"

namespace porttape {
namespace {

const std::string kHead = "format = 'porttape-rules'\nversion = 1\n";

// Returns the text of the rules without its head, and expects that it is read as the same rules.
std::string written(const RuleSet& rules) {
  const std::string text = to_toml(rules);
  EXPECT_EQ(text.substr(0, kHead.size()), kHead);
  const Result<RuleSet> again = read_rules(text, "again.rules");
  EXPECT_TRUE(again) << again.error().message << '\n' << text;
  if (again) {
    EXPECT_TRUE(*again == rules) << text;
  }
  return text.substr(kHead.size());
}

RuleSet read(const std::string& text) {
  const Result<RuleSet> rules = read_rules(text, "my.rules");
  EXPECT_TRUE(rules) << rules.error().message << '\n' << text;
  return rules ? *rules : RuleSet();
}

// A text that is already as it would be written.
void expect_same(const std::string& text) { EXPECT_EQ(written(read(text)), text); }

const std::string kPoll = "\n[[rule]]\nname = 'poll'\nwhen = 'x'\noptional = true\n";

TEST(RulesWriterTest, FramesHaveTheKeysOfTheirKind) {
  for (const char* const keys : {
           "kind = 'delimited'\nend = \"\\r\\n\"\n",
           "kind = 'delimited'\nend = \"*\"\ntrailer = 1\nstart = \"$\"\n",
           "kind = 'delimited'\nend_hex = '0003'\nstart_hex = '1f'\n",
           "kind = 'delimited'\nend_hex = '7f'\nstart = \" ~\"\n",
           "kind = 'delimited'\nend = \"\\\"\\\\\\n\"\n",
           "kind = 'length'\nlength = { at = 2, size = 2, order = 'little', adds = 6 }\n",
           "kind = 'length'\nlength = { at = 0, size = 1, order = 'big', adds = -1 }\n",
           "kind = 'fixed'\nsize = 8\n",
           "kind = 'idle'\nidle_ms = 2.5\n",
           "kind = 'idle'\nidle_ms = 0.001\n",
       })
    expect_same(std::string("\n[[frame]]\nname = 'f'\n") + keys + kPoll);
  expect_same("\n[[frame]]\nname = 'f'\nlongest = 512\nkind = 'fixed'\nsize = 8\n" + kPoll);
}

TEST(RulesWriterTest, ALengthThatASignatureMakesLongerSaysWhere) {
  RuleSet rules = read(kPoll);
  rules.frames.push_back({.name = "f",
                          .kind = FrameFormat::Kind::length,
                          .length = {.at = 1, .size = 1, .adds = 12, .signed_at = 2}});
  EXPECT_EQ(
      written(rules),
      "\n[[frame]]\nname = 'f'\nkind = 'length'\nlength = { at = 1, size = 1, order = 'big', adds = 12, "
      "signed_at = 2 }\n" +
          kPoll);
}

TEST(RulesWriterTest, AChecksumHasWhatIsNotTheUsual) {
  for (const char* const more :
       {"", ", to = -3", ", order = 'little'", ", hex = true", ", hex = true, of_hex = true",
        ", mavlink_extra = true",
        ", to = 9, order = 'little', hex = true, of_hex = true, mavlink_extra = true"})
    expect_same(std::string("\n[[frame]]\nname = 'f'\nkind = 'fixed'\nsize = 8\nstart = \"$\"\n") +
                "checksum = { kind = 'CRC-16/MODBUS', at = -4, from = 1" + more + " }\n" + kPoll);
}

TEST(RulesWriterTest, AProtocolIsOneTableWhateverFormatsItHas) {
  const std::string nmea = "protocol = 'nmea'\n";
  expect_same("\n[[frame]]\nname = 'nmea'\n" + nmea + kPoll);
  expect_same("\n[[frame]]\nname = 'one'\n" + nmea +
              "\n[[frame]]\nname = 'two'\nlongest = 99\nprotocol = 'nmea'\n" + kPoll);
  expect_same("\n[[frame]]\nname = 'one'\n" + nmea +
              "\n[[frame]]\nname = 'two'\nlongest = 65535\nprotocol = 'gdb'\n" + kPoll);
  for (const char* const protocol : {"nmea", "mavlink", "modbus-ascii"}) {
    expect_same(fmt::format("\n[[frame]]\nname = 'f'\nprotocol = '{}'\n{}", protocol, kPoll));
    // 4096 is the usual of frames that are described, not of these.
    expect_same(fmt::format("\n[[frame]]\nname = 'f'\nlongest = 4096\nprotocol = '{}'\n{}", protocol, kPoll));
  }
}

TEST(RulesWriterTest, RulesHaveTheKeysOfTheirPlaceAndKind) {
  for (const char* const keys : {
           "at = 1\nignore = true\n",
           "at = -4\nsize = 2\nignore = true\n",
           "at = 1\nto = -2\nignore = true\n",
           "column = 0\nignore = true\n",
           "column = 3\nseparator = ';'\nignore = true\n",
           "capture = 'a(b)'\nignore = true\n",
           "at = 0\nmask = '0fff'\n",
           "at = 0\nregex = '\\d+'\n",
           "at = 0\nrange = [-1.5, 359.25]\ntype = 'signed'\n",
           "at = 0\nrange = [0, 5]\ntype = 'unsigned'\norder = 'little'\n",
           "at = 0\ncounter = true\ntype = 'hex'\n",
           "at = 0\ncounter = { modulo = 2 }\ntype = 'decimal'\n",
           "at = 0\nto = 9\nignore = true\nlength = [0, 65536]\n",
           "optional = true\n",
           "repeated = true\n",
           "optional = true\nwith_answer = true\nrepeated = true\n",
           "optional = true\nwith_answer = false\n",
       })
    expect_same(std::string("\n[[frame]]\nname = 'f'\nkind = 'fixed'\nsize = 8\n\n[[rule]]\nname = 'r'\n"
                            "frame = 'f'\nwhen = 'x'\n") +
                keys);
}

TEST(RulesWriterTest, RepliesHaveBothPlaces) {
  for (const char* const place :
       {"{ at = 4 }", "{ at = 4, size = 2 }", "{ at = -4, to = -1 }", "{ column = 2, separator = ',' }",
        "{ column = 0, separator = '; ' }", "{ capture = 'x(.)' }"}) {
    const std::string head = "\n[[frame]]\nname = 'f'\nkind = 'fixed'\nsize = 8\n\n[[reply]]\nname = 'r'\n";
    expect_same(head + "frame = 'f'\nwhen = 'w'\nfrom = " + place + "\nanswer_frame = 'f'\nanswer = 'a'\n" +
                "to = { at = 1, size = 1 }\n");
    expect_same(head + "from = { at = 7 }\nto = " + place + "\n");
  }
}

TEST(RulesWriterTest, RedactionsHaveTheKeysOfWhatIsSecretAndOfItsFiller) {
  const std::string head = "\n[[frame]]\nname = 'f'\nkind = 'fixed'\nsize = 8\n\n[[redact]]\nname = 'r'\n";
  for (const char* const keys : {
           "frame = 'f'\nwhen = 'w'\nat = 1\nsize = 2\n",
           "dir = 'r'\ncolumn = 1\n",
           "dir = 'w'\noffset = 0\nsize = 9\n",
           "dir = 'r'\noffset = 7\nsize = 1\nfiller = 'digits'\n",
           "pattern = 'PASS=(\\w+)'\n",
           "pattern = 'p'\nlongest = 20\nevents = false\n",
           "text_hex = '736563726574'\n",
           "text_hex = '00ff'\nevents = false\nfiller = 'hex'\n",
           "pattern = 'p'\nfiller = 'letters'\n",
           "pattern = 'p'\nfiller = 'bytes'\n",
           "pattern = 'p'\nwith_hex = '2a00'\n",
       })
    expect_same(head + keys);
}

TEST(RulesWriterTest, AnyTextIsWrittenSoThatItIsReadAsItIs) {
  const std::vector<std::pair<std::string, std::string>> texts = {
      {"plain ~", "'plain ~'"},           {"it's", "\"it's\""},
      {"it's \"\\", "\"it's \\\"\\\\\""}, {"a\tb\n", "\"a\\u0009b\\u000A\""},
      {"\x1f\x7f", "\"\\u001F\\u007F\""}, {"\xc3\xa4", "\"\xc3\xa4\""},
  };
  for (const auto& [name, text] : texts) {
    RuleSet rules = read(kPoll);
    rules.rules[0].name = name;
    EXPECT_EQ(written(rules), "\n[[rule]]\nname = " + text + "\nwhen = 'x'\noptional = true\n");
  }
}

}  // namespace
}  // namespace porttape
