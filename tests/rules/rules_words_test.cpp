#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/rules_reader.hpp"
#include "libport/rules/toml_table.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

// What is said of a rules file, without its name; empty: it is accepted.
std::string said_of(const std::string& text) {
  const Result<RuleSet> rules = read_rules(text, "f");
  return rules ? std::string() : rules.error().message;
}

const std::string kFormat = "[[frame]]\nname='f'\nkind='delimited'\nend='x'\n";

std::string of_rule(const std::string& keys) { return said_of(kFormat + "[[rule]]\nname='r'\n" + keys); }
std::string of_frame(const std::string& keys) {
  return said_of("[[frame]]\nname='f'\n" + keys + "[[rule]]\nname='r'\nat=0\nignore=true\n");
}

TEST(RulesWordsTest, OfAFrame) {
  const std::vector<std::pair<std::string, std::string>> known = {
      {"kind='delimited'\n",
       "f:1: [[frame]] 'f' is delimited and has no 'end' (or 'end_hex'): what its frames end with"},
      {"kind='delimited'\nend='x'\ntrailer=65\n",
       "f:5: key 'trailer' of [[frame]] 'f' is 65; accepted: a whole number from 0 to 64"},
      {"kind='delimited'\nend='x'\nlongest=65537\n",
       "f:5: key 'longest' of [[frame]] 'f' is 65537; accepted: a whole number from 1 to 65536"},
      {"kind='delimited'\nend='x'\nlongest=0\n",
       "f:5: key 'longest' of [[frame]] 'f' is 0; accepted: a whole number from 1 to 65536"},
      {"kind='delimited'\nend='x'\nend_hex='00'\n",
       "f:4: key 'end' of [[frame]] 'f' is there besides 'end_hex'; accepted: one of them"},
      {"kind='delimited'\nstart_hex='" + std::string(514, '0') + "'\nend='" + std::string(257, 'x') + "'\n",
       "f:4: key 'start_hex' of [[frame]] 'f' has 257 bytes; accepted: 256 at most\n"
       "f:5: key 'end' of [[frame]] 'f' has 257 bytes; accepted: 256 at most"},
      {"kind='delimited'\nstart='" + std::string(256, 'x') + "'\nend='" + std::string(256, 'x') + "'\n", ""},
      {"kind='delimited'\nstart='ab'\nend='c'\ntrailer=2\nlongest=4\n",
       "f:1: [[frame]] 'f' has 5 bytes at least, by its 'start', 'end' and 'trailer', and 4 at most, by "
       "'longest': there is no such frame"},
      {"kind='delimited'\nstart='ab'\nend='c'\ntrailer=2\nlongest=5\n", ""},
      {"kind='fixed'\nstart='ab'\nsize=1\n",
       "f:1: [[frame]] 'f' has 2 bytes at least, by its 'start', and 1 at most, by 'size': there is no such "
       "frame"},
      {"kind='fixed'\nstart='ab'\nsize=2\n", ""},
      {"kind='length'\n", "f:1: [[frame]] 'f' has no 'length'; accepted: { at = …, size = …, adds = … }"},
      {"kind='length'\nlength=3\n",
       "f:4: key 'length' of [[frame]] 'f' is of the kind integer; accepted: a table, { … }"},
      {"kind='fixed'\n", "f:1: [[frame]] 'f' is fixed and has no 'size': bytes of each frame"},
      {"kind='fixed'\nsize=0\n",
       "f:4: key 'size' of [[frame]] 'f' is 0; accepted: a whole number from 1 to 65536"},
      {"kind='idle'\n", "f:1: [[frame]] 'f' is idle and has no 'idle_ms': the pause that ends a frame"},
      {"kind='idle'\nidle_ms=60001\n",
       "f:4: key 'idle_ms' of [[frame]] 'f' is 60001; accepted: a number from 0.001 to 60000"},
      {"kind='idle'\nidle_ms='2'\n",
       "f:4: key 'idle_ms' of [[frame]] 'f' is of the kind string; accepted: a number from 0.001 to 60000"},
      {"kind='delimited'\nend='x'\nchecksum={at=-1}\n",
       "f:5: 'checksum' of [[frame]] 'f' has no 'kind': 'CRC-16/MODBUS', 'XOR', …"},
      {"kind='delimited'\nend=7\n",
       "f:1: [[frame]] 'f' is delimited and has no 'end' (or 'end_hex'): what its frames end with\n"
       "f:4: key 'end' of [[frame]] 'f' is of the kind integer; accepted: text in quotes"},
  };
  for (const auto& [keys, words] : known) EXPECT_EQ(of_frame(keys), words);
  EXPECT_THAT(of_frame(""), HasSubstr("has neither 'kind' nor 'protocol'; accepted: kind: delimited, length, "
                                      "fixed, idle; protocol: "));
  EXPECT_THAT(said_of("[[frame]]\nkind='fixed'\nsize=1\n[[rule]]\nname='r'\nat=0\nignore=true\n"),
              HasSubstr("f:1: [[frame]] lacks 'name': a name of its own"));
  EXPECT_EQ(said_of(kFormat + kFormat + "[[rule]]\nname='r'\nat=0\nignore=true\n").substr(0, 84),
            "f:6: key 'name' of [[frame]] 'f' is 'f', as of an earlier one; accepted: a name of i");
}

TEST(RulesWordsTest, ExpressionsHaveSoManySteps) {
  EXPECT_EQ(of_rule("capture='^Q(.{0,1000})'\nignore=true\n"), "");
  EXPECT_EQ(
      of_rule("capture='(.{0,900}.{0,900})'\nignore=true\n"),
      "f:7: key 'capture' of [[rule]] 'r' has 3606 steps; accepted: 2100 at most ('.{0,100}' has 200 of "
      "them)");
  const auto rules = [](int count) {
    std::string text = kFormat;
    for (int i = 0; i < count; ++i)
      text += "[[rule]]\nname='r" + std::to_string(i) + "'\ncapture='(.{0,900})'\nignore=true\n";
    return said_of(text);
  };
  EXPECT_EQ(rules(11), "");
  EXPECT_THAT(rules(13), testing::AllOf(testing::EndsWith("steps; accepted: 20000 at most"),
                                        testing::Not(HasSubstr("\n"))))
      << "it is told once";
}

TEST(RulesWordsTest, AFileHasSoManyTables) {
  const auto redactions = [](int count) {
    std::string text;
    for (int i = 0; i < count; ++i) text += "[[redact]]\nname='r" + std::to_string(i) + "'\ntext='x'\n";
    return said_of(text);
  };
  EXPECT_EQ(redactions(1000), "");
  EXPECT_EQ(redactions(1001), "f:1: there are 1001 of [[redact]]; accepted: 1000 at most");
}

TEST(RulesWordsTest, TheLastThatIsAcceptedOfEachBoundIs) {
  for (const char* const keys : {
           "kind='delimited'\nend='x'\ntrailer=64\nlongest=65536\n",
           "kind='delimited'\nend='x'\ntrailer=0\nlongest=1\n",
           "kind='fixed'\nsize=65536\n",
           "kind='fixed'\nsize=1\n",
           "kind='idle'\nidle_ms=60000\n",
           "kind='idle'\nidle_ms=0.001\n",
           "kind='fixed'\nsize=8\nchecksum={kind='CRC-16/MODBUS',at=-2}\n",
           "kind='fixed'\nsize=8\nchecksum={kind='XOR',hex=true,at=-2}\n",
       })
    EXPECT_EQ(of_frame(keys), "") << keys;
  for (const char* const keys : {
           "at=65535\nignore=true\n",
           "at=-65535\nignore=true\n",
           "at=0\nsize=65535\nignore=true\n",
           "at=-3\nsize=3\nignore=true\n",
           "at=5\nto=6\nignore=true\n",
           "at=5\nto=-65535\nignore=true\n",
           "at=-5\nto=1\nignore=true\n",
           "at=-5\nto=-4\nignore=true\n",
           "column=1000\nignore=true\n",
           "at=0\nsize=8\ncounter=true\n",
           "at=0\nsize=9\ncounter=true\ntype='decimal'\n",
           "at=0\nsize=9\nrange=[1,1]\ntype='hex'\n",
           "at=0\ncounter={modulo=2}\n",
           "at=0\ncounter={modulo=4611686018427387904}\n",
           "at=0\nignore=true\nlength=[0,65536]\n",
           "optional=true\nframe='f'\n",
           "optional=true\nwhen='x'\n",
           "repeated=true\nwhen='x'\n",
       })
    EXPECT_EQ(of_rule(keys), "") << keys;
}

TEST(RulesWordsTest, ALengthAndAChecksumHaveTheirBounds) {
  const auto length = [](const std::string& keys) {
    return of_frame("kind='length'\nlength={" + keys + "}\n");
  };
  const auto checksum = [](const std::string& keys) {
    return of_frame("kind='fixed'\nsize=8\nchecksum={kind='XOR'," + keys + "}\n");
  };
  for (const char* const keys :
       {"at=0,size=1,adds=-65535,signed_at=0", "at=1024,size=4,adds=65535,signed_at=1024"})
    EXPECT_EQ(length(keys), "") << keys;
  for (const char* const keys :
       {"at=-1", "at=1,from=-65535,to=-65535", "at=65535,from=65535,to=65535", "at=-65535"})
    EXPECT_EQ(checksum(keys), "") << keys;
  for (const char* const keys : {"at=-1", "at=1025", "at=0,size=0", "at=0,size=5", "at=0,adds=-65536",
                                 "at=0,adds=65536", "at=0,signed_at=-1", "at=0,signed_at=1025"})
    EXPECT_THAT(length(keys), HasSubstr("; accepted: a whole number from ")) << keys;
  for (const char* const keys :
       {"at=-65536", "at=65536", "from=-65536", "from=65536", "to=-65536", "to=65536"})
    EXPECT_THAT(checksum(keys), HasSubstr("; accepted: a whole number from -65535 to 65535")) << keys;
  EXPECT_EQ(length("size=1"),
            "f:4: 'length' of [[frame]] 'f' has no 'at': where the number stands in the frame");
}

TEST(RulesWordsTest, OfARule) {
  const std::string in = " of [[rule]] 'r' ";
  const std::vector<std::pair<std::string, std::string>> known = {
      {"at=0\nto=0\nignore=true\n",
       "f:8: key 'to'" + in + "is 0, and 'at' is 0; accepted: a position behind it"},
      {"at=5\nto=3\nignore=true\n",
       "f:8: key 'to'" + in + "is 3, and 'at' is 5; accepted: a position behind it"},
      {"at=-4\nto=-4\nignore=true\n",
       "f:8: key 'to'" + in + "is -4, and 'at' is -4; accepted: a position behind it"},
      {"at=-1\nsize=2\nignore=true\n",
       "f:8: key 'size'" + in + "is 2, and from 'at' = -1 to the frame's end there are 1"},
      {"column=1001\nignore=true\n",
       "f:7: key 'column'" + in + "is 1001; accepted: a whole number from 0 to 1000"},
      {"column=0\nseparator=''\nignore=true\n", "f:8: key 'separator'" + in + "is empty"},
      {"at=0\nsize=9\nrange=[1,2]\n", "f:8: key 'size'" + in + "is 9; accepted: up to 8 bytes for a number"},
      {"at=0\ncounter=false\n",
       "f:8: key 'counter'" + in + "is false; accepted: true, { modulo = … }, or another kind of rule"},
      {"at=0\ncounter={modulo=1}\n", "f:8: key 'modulo' of 'counter'" + in +
                                         "is 1; accepted: a whole number from 2 to 4611686018427387904"},
      {"at=0\nignore=false\n",
       "f:8: key 'ignore'" + in + "is false; accepted: true, or another kind of rule"},
      {"at=0\nignore=true\norder='big'\n",
       "f:9: key 'order'" + in + "has no meaning here: it is of a range or a counter"},
      {"at=0\nmask='0f'\nlength=[1,2]\n", "f:9: key 'length'" + in + "has no meaning with a mask"},
      {"at=0\nignore=true\nlength=[1,65537]\n",
       "f:9: key 'length'" + in + "is [1, 65537]; accepted: whole numbers of bytes from 0 to 65536"},
      {"at=0\nignore=true\nlength=[-1,2]\n",
       "f:9: key 'length'" + in + "is [-1, 2]; accepted: whole numbers of bytes from 0 to 65536"},
      {"at=0\nignore=true\nlength=[1,2.5]\n",
       "f:9: key 'length'" + in + "is [1, 2.5]; accepted: whole numbers of bytes from 0 to 65536"},
      {"at=0\nrange=[2,1]\n", "f:8: key 'range'" + in + "is [2, 1]; accepted: the smaller number first"},
      {"at=0\nrange=[1,2,3]\n",
       "f:8: key 'range'" + in + "is of the kind array; accepted: two numbers, [least, most]"},
      {"at=0\nrange=[1,'2']\n",
       "f:8: key 'range'" + in + "is of the kind array; accepted: two numbers, [least, most]"},
      {"at=0\nrange=['1',2]\n",
       "f:8: key 'range'" + in + "is of the kind array; accepted: two numbers, [least, most]"},
      {"at=0\nmask='0g'\n",
       "f:8: key 'mask'" + in + "is '0g'; accepted: two hexadecimal digits for each byte"},
      {"at=0\nmask=''\n", "f:8: key 'mask'" + in + "is ''; accepted: two hexadecimal digits for each byte"},
      {"when='x'\noptional=true\nignore=true\nat=0\n",
       "f:5: [[rule]] 'r' is about the whole frame (optional, repeated) and about a part of it; accepted: a "
       "rule for each\nf:10: [[rule]] 'r' has no key 'at'"},
      {"when='x'\nrepeated=true\nwith_answer=true\n",
       "f:9: key 'with_answer'" + in + "is of what may be left out; accepted: with optional = true"},
      {"at=0\nignore=true\nmask='00'\n",
       "f:5: [[rule]] 'r' needs one of ignore, mask, regex, range, counter, optional, repeated: how the "
       "bytes "
       "may vary"},
      {"ignore=true\n", "f:5: [[rule]] 'r' needs one of at, column, capture: where in the frame"},
  };
  for (const auto& [keys, words] : known) EXPECT_EQ(of_rule(keys), words);
  EXPECT_EQ(said_of("[[rule]]\nat=0\nignore=true\n"), "f:1: [[rule]] lacks 'name': a name of its own");
  EXPECT_EQ(of_rule("at=0\nignore=true\n[[rule]]\nname='r'\nat=0\nignore=true\n"),
            "f:10: key 'name' of [[rule]] 'r' is that of an earlier rule; accepted: one of its own");
}

TEST(RulesWordsTest, TheNameOfAFrameThatIsMeantIsSuggested) {
  EXPECT_EQ(
      said_of("[[frame]]\nname='status'\nkind='delimited'\nend='x'\n"
              "[[rule]]\nname='r'\nframe='sttaus'\nat=0\nignore=true\n"),
      "f:7: key 'frame' of [[rule]] 'r' is 'sttaus', and there is no [[frame]] of that name; did you mean "
      "'status'?");
}

TEST(RulesWordsTest, OfAReply) {
  const auto of = [](const std::string& keys) { return said_of(kFormat + "[[reply]]\n" + keys); };
  const std::string place = "; accepted: { at = …, size = … }, { column = … }, { capture = … }";
  EXPECT_EQ(of("name='r'\nfrom={at=0}\nto={at=0}\n"), "");
  EXPECT_EQ(of("name='r'\nto={at=0}\n"), "f:5: [[reply]] 'r' has no 'from'" + place);
  EXPECT_EQ(of("name='r'\nfrom={at=0}\n"), "f:5: [[reply]] 'r' has no 'to'" + place);
  EXPECT_EQ(of("from={at=0}\nto={at=0}\n"), "f:5: [[reply]] lacks 'name': a name of its own");
  EXPECT_EQ(of("name='r'\nfrom={at=0,x=1}\nto={at=0}\n"), "f:7: 'from' of [[reply]] 'r' has no key 'x'");
  EXPECT_EQ(of("name='r'\nfrom={at=0}\nto={at=0}\nanswer_frame='g'\n"),
            "f:9: key 'answer_frame' of [[reply]] 'r' is 'g', and there is no [[frame]] of that name");
}

TEST(RulesWordsTest, OfARedaction) {
  const auto of = [](const std::string& keys) { return said_of("[[redact]]\nname='x'\n" + keys); };
  const std::string long_text(65536, 'a');
  for (const std::string& keys :
       {"text='" + long_text + "'\n", "text='a'\nwith='" + long_text + "'\n",
        std::string("pattern='a'\nlongest=1\n"), std::string("pattern='a'\nlongest=65536\n"),
        std::string("dir='r'\noffset=0\nsize=1\n"), std::string("text='a'\nevents=false\n"),
        std::string("dir='w'\noffset=4611686018427387904\nsize=1\n")})
    EXPECT_EQ(of(keys), "") << keys.substr(0, 40);
  EXPECT_EQ(of("text='" + long_text + "a'\n"),
            "f:1: [[redact]] 'x' has a 'text' that is empty or of more than 65536 bytes");
  EXPECT_EQ(of("text=''\n"), "f:1: [[redact]] 'x' has a 'text' that is empty or of more than 65536 bytes");
  EXPECT_EQ(of("text='a'\nwith='" + long_text + "a'\n"),
            "f:1: [[redact]] 'x' has a 'with' without bytes, or too many");
  EXPECT_EQ(of("text='a'\nwith=''\n"), "f:1: [[redact]] 'x' has a 'with' without bytes, or too many");
  EXPECT_EQ(of("pattern=''\n"),
            "f:3: key 'pattern' of [[redact]] 'x' is empty; accepted: an expression of what is secret");
  EXPECT_EQ(of("pattern='a'\nlongest=0\n"),
            "f:4: key 'longest' of [[redact]] 'x' is 0; accepted: a whole number from 1 to 65536");
  EXPECT_EQ(of("dir='r'\noffset=3\n"), "f:1: [[redact]] 'x' has an 'offset' and no 'size': how many bytes");
  EXPECT_EQ(
      of("dir='r'\noffset=-1\nsize=0\n"),
      "f:4: key 'offset' of [[redact]] 'x' is -1; accepted: a whole number from 0 to 4611686018427387904\n"
      "f:5: key 'size' of [[redact]] 'x' is 0; accepted: a whole number from 1 to 4611686018427387904");
  EXPECT_EQ(of("offset=3\nsize=1\n"),
            "f:1: [[redact]] 'x' has an 'offset' and no 'dir': of which stream; accepted: 'r', 'w'");
  EXPECT_EQ(of("text='a'\nfiller='hex'\nwith_hex='00'\n"),
            "f:4: key 'filler' of [[redact]] 'x' is there besides 'with'; accepted: one of them");
  EXPECT_EQ(of("text='a'\n[[redact]]\nname='x'\ntext='b'\n"),
            "f:5: key 'name' of [[redact]] 'x' is that of an earlier [[redact]]; accepted: one of its own");
  EXPECT_EQ(said_of("[[redact]]\ntext='b'\n"), "f:1: [[redact]] lacks 'name': a name of its own");
}

TEST(RulesWordsTest, TheFirstTwentyMistakesAreToldAndTheOthersCounted) {
  const auto lines_of = [](int mistakes) {
    Problems problems("a\nb");
    for (int i = mistakes; i > 0; --i) problems.tell(static_cast<std::size_t>(i), "x");
    EXPECT_EQ(problems.any(), mistakes > 0);
    return problems.error().message;
  };
  EXPECT_EQ(lines_of(0), "");
  const std::string twenty = lines_of(20);
  EXPECT_EQ(std::count(twenty.begin(), twenty.end(), '\n'), 19);
  EXPECT_THAT(twenty, testing::EndsWith(":20: x"));
  EXPECT_EQ(lines_of(23), twenty + "\nand 3 more of the kind");
  EXPECT_THAT(lines_of(2), HasSubstr(":1: x\n"));
}

TEST(RulesWordsTest, WhatIsNoTextEndsTheFileAndIsRefused) {
  const auto parses = [](const std::string& text) { return static_cast<bool>(parse_toml(text, "f")); };
  for (const char* const text : {
           "a = 'x' # \xC3\xA4\nb = 1",
           "a = \"\\\"\xC3\xA4\"",
           "a = \"\\\\\"\nb = 'c'",
           "a = 'c:\\'\nb = '\xC3\xA4'",
           "a = '''\n\xC3\xA4'\n'''",
           "a = \"\"\"\n\xC3\xA4 \\\"\"\" \"\"\"",
           "a = ''\nb = '\xC3\xA4'",
           "\xEF\xBB\xBF'a' = 1",
           "\xEF\xBB\xBF"
           "a = 1",
           "'a' = {'b'='c','d'=['e']}",
           "",
       })
    EXPECT_TRUE(parses(text)) << text;
  for (const char* const text :
       {"a = 1 \xC3\xA4", "a'b' = 1", "a = 'x\n\xC3\xA4 = 1", "a = \"x", "'a'\xC3\xA4 = 1"})
    EXPECT_FALSE(parses(text)) << text;
}

}  // namespace
}  // namespace porttape
