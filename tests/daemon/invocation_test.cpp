#include "daemon/invocation.hpp"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::HasSubstr;

Result<Invocation> parse(const std::vector<std::string>& arguments) { return parse_invocation(arguments); }

std::string error_of(const std::vector<std::string>& arguments) {
  const Result<Invocation> line = parse(arguments);
  EXPECT_FALSE(line.has_value());
  if (line) return {};
  EXPECT_EQ(line.error().code, Errc::usage);
  return line.error().message;
}

TEST(Invocation, AVerbMakesOneChannel) {
  const Result<Invocation> line = parse({"record", "--device", "/dev/x", "--driver=pty:/tmp/x", "--tape", "t",
                                         "--overwrite", "-b", "--pidfile", "p"});
  ASSERT_TRUE(line.has_value()) << line.error().message;
  ASSERT_EQ(line->channels.size(), 1U);
  const ChannelSpec& channel = line->channels.at("record");
  EXPECT_EQ(channel.mode, ChannelMode::record);
  EXPECT_EQ(channel.values.at("driver"), "pty:/tmp/x");
  EXPECT_EQ(channel.values.at("overwrite"), "1");
  EXPECT_TRUE(line->background);
  EXPECT_EQ(line->pid_file, "p");
}

TEST(Invocation, EveryVerbHasHelpWithAnExample) {
  for (const char* verb : {"record", "replay", "bridge"}) {
    const Result<Invocation> line = parse({verb, "--help"});
    ASSERT_TRUE(line.has_value());
    EXPECT_THAT(line->print.value_or(""), HasSubstr("Example: porttaped " + std::string(verb)));
  }
  EXPECT_THAT(parse({"run", "--help"})->print.value_or(""), HasSubstr("[channel laser]"));
  EXPECT_THAT(parse({"--help"})->print.value_or(""), HasSubstr("porttaped record"));
  EXPECT_THAT(parse({"--help-ports"})->print.value_or(""), HasSubstr("serial:device"));
  EXPECT_THAT(parse({"--version"})->print.value_or(""), HasSubstr("porttaped "));
}

TEST(Invocation, EveryReplayOptionOfTheContractIsThere) {
  for (const char* option : {"strictness", "jitter", "timing", "rate", "on-mismatch", "at-end", "on-reopen",
                             "chunks", "burst-gap", "patience", "once", "report"}) {
    EXPECT_THAT(parse({"replay", "--help"})->print.value_or(""), HasSubstr(std::string("--") + option));
  }
}

TEST(Invocation, WrongWordsAreUsageErrors) {
  EXPECT_THAT(error_of({}), HasSubstr("verb is missing"));
  EXPECT_THAT(error_of({"play"}), HasSubstr("'play'"));
  EXPECT_THAT(error_of({"record", "--colour"}), HasSubstr("colour"));
  EXPECT_THAT(error_of({"record", "--%canonical_option%"}),
              HasSubstr("unrecognised option '--%canonical_option%'"));
  EXPECT_THAT(error_of({"record", "--dev", "/dev/x"}), HasSubstr("dev"));
  EXPECT_THAT(error_of({"record", "--log-level", "loud"}), HasSubstr("'loud'"));
  EXPECT_THAT(error_of({"run"}), HasSubstr("configuration file is missing"));
  EXPECT_THAT(error_of({"record", "stray"}), HasSubstr("positional"));
}

}  // namespace
}  // namespace porttape
