#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using test::TempDir;
using testing::HasSubstr;
using testing::Not;

constexpr std::string_view kLines = "[[frame]]\nname = 'line'\nkind = 'delimited'\nend = \"\\n\"\n";

class RulesCheck : public ::testing::Test {
 protected:
  RulesCheck() {
    tape_ = make_tape(dir_, "t", {{15, "ok\n"}, {35, "ok\n"}},
                      {{10, "T=1;\n"}, {20, "GO\n"}, {30, "T=23;\n"}, {40, "rest"}});
  }
  test::Ran check(std::string_view rules, const std::vector<std::string>& options = {}) {
    test::write_file(dir_ / "my.rules", test::bytes_of(std::string(kLines) + std::string(rules)));
    std::vector<std::string> args{"rules", "check", tape_, dir_ / "my.rules"};
    args.insert(args.end(), options.begin(), options.end());
    return run(args);
  }

  TempDir dir_;
  std::string tape_;
};

TEST_F(RulesCheck, SaysWhatEachRuleIsAbout) {
  const auto ran = check("[[rule]]\nname = 't'\ncapture = 'T=([0-9]+)'\nregex = '\\d+'\nlength = [1, 9]\n");
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("frames of 'line': 3\n"));
  EXPECT_THAT(ran.out,
              HasSubstr("my.rules:5: rule 't': 2 times, first exchange 1, 0.000010 s, byte 0 of the writes\n"
                        "  \"1\"  31 in \"T=1;\\n\"\n"));
  EXPECT_THAT(
      ran.out,
      HasSubstr("1 frame no rule is about (compared as recorded), first exchange 2, 0.000020 s, byte 5"));
  EXPECT_THAT(ran.out,
              HasSubstr("4 bytes in no frame (compared as recorded), first exchange 3, 0.000040 s, byte 14"));
}

TEST_F(RulesCheck, ARuleThatIsAboutNothingIs3) {
  const auto ran = check("[[rule]]\nname = 'x'\nwhen = '^X'\nat = 0\nignore = true\n");
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out, HasSubstr("my.rules:5: rule 'x': never matched\n"));
}

TEST_F(RulesCheck, RulesThatOverlapAre3) {
  const auto ran = check(
      "[[rule]]\nname = 'a'\nwhen = '^T'\nat = 2\nsize = 1\nignore = true\n"
      "[[rule]]\nname = 'b'\nat = 0\nsize = 3\nignore = true\n");
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out,
              HasSubstr("my.rules:11: rule 'b' overlaps rule 'a' (line 5), which goes before it: 2 times"));
}

TEST_F(RulesCheck, AReplyIsAboutRequestsWithAnAnswerOfItsOwn) {
  const auto ran = check(
      "[[reply]]\nname = 'r'\nwhen = '^T'\nfrom = { at = 2, size = 1 }\nto = { at = 0, size = 1 }\n"
      "[[reply]]\nname = 's'\nfrom = { at = 0, size = 1 }\nanswer = 'no'\nto = { at = 0, size = 1 }\n");
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out, HasSubstr("reply 'r': 2 times, first exchange 1"));
  EXPECT_THAT(ran.out, HasSubstr("reply 's': never matched"));
}

TEST_F(RulesCheck, AsJson) {
  const auto ran = check("[[rule]]\nname = 't'\ncapture = 'T=([0-9]+)'\nignore = true\n", {"--json"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr(R"("ok":true,"frames":3,)"));
  EXPECT_THAT(ran.out,
              HasSubstr(R"("rules":[{"name":"t","line":5,"use":{"count":2,"first":{"t_us":10,"offset":0,)"
                        R"("exchange":1,"frame_hex":"543d313b0a","begin":2,"end":3}}}])"));
}

TEST_F(RulesCheck, MistakesInTheFileAre2AndEachHasALine) {
  const auto ran =
      check("[[rule]]\nname = 'a'\nat = 0\nregex = '('\n[[rule]]\nname = 'b'\nfrom = 1\nignore = true\n");
  EXPECT_EQ(ran.status, 2);
  EXPECT_THAT(ran.err, HasSubstr("my.rules:8: key 'regex' of [[rule]] 'a' is no regular expression"));
  EXPECT_THAT(ran.err, HasSubstr("my.rules:11: [[rule]] 'b' has no key 'from'"));
  EXPECT_EQ(ran.out, "");
}

}  // namespace
}  // namespace porttape
