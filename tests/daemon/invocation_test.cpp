#include "daemon/invocation.hpp"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/help_width.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::EndsWith;
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
  for (const char* option :
       {"strictness", "jitter", "timing", "rate", "on-mismatch", "at-end", "on-reopen", "chunks", "burst-gap",
        "match", "patience", "check-settings", "once", "report"}) {
    EXPECT_THAT(parse({"replay", "--help"})->print.value_or(""), HasSubstr(std::string("--") + option));
  }
}

TEST(Invocation, WrongWordsAreUsageErrors) {
  EXPECT_THAT(error_of({}), HasSubstr("verb is missing"));
  EXPECT_THAT(error_of({"play"}), HasSubstr("unknown verb 'play'; accepted: record, "));
  EXPECT_THAT(error_of({"record", "--%canonical_option%"}),
              HasSubstr("unknown option '--%canonical_option%'"));
  EXPECT_THAT(error_of({"record", "--%canonical_option%=1"}),
              HasSubstr("unknown option '--%canonical_option%'"));
  EXPECT_THAT(error_of({"record", "--dev", "/dev/x"}),
              EndsWith("unknown option '--dev'; did you mean '--device'?"));
  EXPECT_THAT(error_of({"record", "-x"}), HasSubstr("unknown option '-x'"));
  EXPECT_THAT(error_of({"record", "--log-level", "loud"}), HasSubstr("'loud'"));
  EXPECT_THAT(error_of({"run"}), HasSubstr("configuration file is missing"));
  EXPECT_THAT(error_of({"run", "a", "b"}), HasSubstr("'b' is one too many"));
  EXPECT_THAT(error_of({"replay", "--tape"}), HasSubstr("option '--tape' has no value; type --tape NAME"));
  EXPECT_THAT(error_of({"replay", "--tape="}), HasSubstr("type --tape NAME"));
  EXPECT_THAT(error_of({"replay", "--tape", ""}), HasSubstr("option '--tape' is empty"));
  EXPECT_THAT(error_of({"replay", "--once=1"}), HasSubstr("takes no value"));
  EXPECT_THAT(error_of({"replay", "--tape", "a", "--tape", "b"}), HasSubstr("is given twice"));
}

TEST(Invocation, AnOptionOfAnotherVerbOrOfAPortIsToldSo) {
  EXPECT_EQ(error_of({"bridge", "--tape", "x"}), "option 'tape' is one of record, not of bridge");
  EXPECT_EQ(error_of({"record", "--baud", "9600"}),
            "option 'baud' is one of a port; write it behind the port: PORT,baud=RATE");
}

TEST(Invocation, ABareWordIsAnsweredWithTheWholeLine) {
  EXPECT_THAT(
      error_of({"record", "/dev/ttyUSB0"}),
      EndsWith("did you mean 'porttaped record --device /dev/ttyUSB0 --driver pty:/tmp/port --tape NAME'?"));
  EXPECT_THAT(error_of({"record", "--device", "a", "pty:/tmp/x", "--tape=t"}),
              EndsWith("did you mean 'porttaped record --device a --driver pty:/tmp/x --tape=t'?"));
  EXPECT_THAT(error_of({"replay", "laser.log"}),
              EndsWith("did you mean 'porttaped replay --tape laser.log --driver pty:/tmp/port'?"));
  EXPECT_THAT(error_of({"bridge", "--device", "a", "--driver", "b", "c"}), HasSubstr("'c' is not an option"));
}

TEST(Invocation, WhatIsNoVerbIsAnsweredWithTheOneThatWasMeant) {
  EXPECT_EQ(error_of({"recrod"}), "unknown verb 'recrod'; did you mean 'record'?");
  EXPECT_EQ(error_of({"verify", "a b"}), "'verify' is a verb of porttape: porttape verify 'a b'");
  EXPECT_THAT(error_of({"laser.log"}),
              EndsWith("did you mean 'porttaped replay --tape laser.log --driver pty:/tmp/port'?"));
  EXPECT_THAT(error_of({"robot.conf"}), EndsWith("did you mean 'porttaped run robot.conf'?"));
  EXPECT_THAT(error_of({"--device", "x"}), HasSubstr("verb is missing before '--device'"));
  EXPECT_THAT(error_of({"--hepl"}), EndsWith("did you mean '--help'?"));
}

TEST(Invocation, TheOptionsAreCheckedAtOnce) {
  EXPECT_THAT(error_of({"bridge", "--device", "ttyUSB0", "--driver", "pty"}),
              EndsWith("did you mean '/dev/ttyUSB0'?"));
  EXPECT_THAT(error_of({"bridge", "--device", "pty:/tmp/x", "--driver", "pty:/tmp/x"}),
              HasSubstr("link '/tmp/x' is there twice"));
}

TEST(Invocation, HelpIsTextOfEightyColumns) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"-h"},
                                             {"help"},
                                             {"--help-ports"},
                                             {"record", "-h"},
                                             {"replay", "-h"},
                                             {"bridge", "--help"},
                                             {"run", "-h"},
                                             {"record", "--help-ports"}}) {
    const Result<Invocation> line = parse(arguments);
    ASSERT_TRUE(line.has_value()) << line.error().message;
    EXPECT_EQ(test::first_long_line(line->print.value_or("")), "") << arguments.front();
  }
}

TEST(Invocation, HelpForAVerbIsTheVerbsOwn) {
  for (const std::string verb : {"record", "replay", "bridge", "run"}) {
    const Result<Invocation> asked = parse({"help", verb});
    const Result<Invocation> own = parse({verb, "--help"});
    ASSERT_TRUE(asked && own) << verb;
    EXPECT_EQ(asked->print, own->print) << verb;
    EXPECT_NE(asked->print, parse({"help"})->print) << verb;
  }
}

TEST(Invocation, AConfigurationIsCheckedWithoutStarting) {
  const test::TempDir dir;
  const std::string file = dir / "robot.conf";
  test::write_file(file, as_bytes("[channel a]\ndevice = /dev/x\ndriver = pty\n"));
  const Result<Invocation> line = parse({"run", file, "--check-config"});
  ASSERT_TRUE(line.has_value());
  EXPECT_EQ(line->print, file + ": 1 channel, good\n");
  EXPECT_TRUE(line->channels.empty());
}

TEST(Invocation, AConfigurationsChannelsRunAndAreKept) {
  const test::TempDir dir;
  const std::string file = dir / "robot.conf";
  test::write_file(file, as_bytes("[channel a]\ndevice = /dev/x\ndriver = pty\n"));
  const Result<Invocation> line = parse({"run", file, "--log-level", "error", "--log-file", "l"});
  ASSERT_TRUE(line.has_value());
  EXPECT_EQ(line->print, std::nullopt);
  EXPECT_EQ(line->verb, "run");
  EXPECT_TRUE(line->keeps_channels);
  ASSERT_TRUE(line->channels.contains("a"));
  EXPECT_EQ(line->channels.at("a").values.at("device"), "/dev/x");
  EXPECT_EQ(line->log_level, spdlog::level::err);
  EXPECT_EQ(line->log_file, "l");
  EXPECT_FALSE(line->background);
}

}  // namespace
}  // namespace porttape
