#include "libport/taped/rules_file.hpp"

#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

const std::string kRule = "[[rule]]\nname='r'\nat=0\nignore=true\n";

std::string refused(const std::string& path) {
  const Result<RuleSet> rules = read_rules_file(path);
  EXPECT_FALSE(rules);
  if (rules) return {};
  EXPECT_EQ(rules.error().code, Errc::usage);
  return rules.error().message;
}

class RulesFileTest : public testing::Test {
 protected:
  void write(const std::string& text) { test::write_file(path, as_bytes(text)); }

  test::TempDir dir;
  const std::string path = dir / "my.rules";
};

TEST_F(RulesFileTest, HasTheRulesAndItsName) {
  write(kRule);
  const Result<RuleSet> rules = read_rules_file(path);
  ASSERT_TRUE(rules) << rules.error().message;
  EXPECT_EQ(rules->file, path);
  ASSERT_EQ(rules->rules.size(), 1U);
  EXPECT_EQ(rules->rules[0].name, "r");
}

TEST_F(RulesFileTest, OfAMistakeTheFileAndTheLineAreNamed) {
  write(kRule + "x=1\n");
  EXPECT_EQ(refused(path), path + ":5: [[rule]] 'r' has no key 'x'");
}

TEST_F(RulesFileTest, OneThatCannotBeReadIsNamedWithWhy) {
  const std::string advice = "; name a TOML file, see porttape rules check --help";
  EXPECT_EQ(refused(path), "rules file '" + path + "': No such file or directory" + advice);
  EXPECT_EQ(refused(dir.path().string()),
            "rules file '" + dir.path().string() + "': Is a directory" + advice);
  EXPECT_EQ(refused("-"), "rules file '-': name a file; standard input is /dev/stdin");
}

TEST_F(RulesFileTest, MoreThanAMegabyteIsNone) {
  const std::size_t most = std::size_t{1} << 20;
  write(kRule + std::string(most - kRule.size(), '#'));
  EXPECT_TRUE(read_rules_file(path));
  write(kRule + std::string(most - kRule.size() + 1, '#'));
  EXPECT_EQ(refused(path), "rules file '" + path + "' has more than a megabyte; is it one?");
}

}  // namespace
}  // namespace porttape
