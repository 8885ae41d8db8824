#include <array>

#include <gtest/gtest.h>

#include "libport/port/help_table.hpp"
#include "libport/port/port_type.hpp"
#include "tests/support/help_width.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

const OptionSpec kJitter{.name = "jitter",
                         .kind = Kind::number,
                         .default_value = "100",
                         .help = "a margin",
                         .max = 1e9,
                         .unit = "ms"};
const OptionSpec kLevel{"level", Kind::integer, "0", "how much", 0, 2};
const OptionSpec kPort{"port", Kind::integer, "", "where", 1, 65535};
const OptionSpec kFlag{"once", Kind::flag, "", "ends then"};
const OptionSpec kChoice{"parity", Kind::choice, "none", "a bit", 0, 0, {"none", "even", "odd"}};
const OptionSpec kFile{.name = "file", .help = "what is read", .value_name = "FILE"};

std::string error_of(const OptionSpec& option, std::string_view value) {
  const Result<std::string> checked = check_value(option, value);
  return checked ? "good" : checked.error().message;
}

TEST(Option, HelpShowsWhatIsAcceptedAndTheDefault) {
  EXPECT_EQ(value_name(kJitter) + ": " + help_of(kJitter), "MS: a margin [0 or more, default 100]");
  EXPECT_EQ(value_name(kLevel) + ": " + help_of(kLevel), "0|1|2: how much [default 0]");
  EXPECT_EQ(value_name(kPort) + ": " + help_of(kPort), "N: where [1 to 65535]");
  EXPECT_EQ(value_name(kFlag) + ": " + help_of(kFlag), ": ends then");
  EXPECT_EQ(value_name(kChoice) + ": " + help_of(kChoice), "none|even|odd: a bit [default none]");
  EXPECT_EQ(value_name(kFile) + ": " + help_of(kFile), "FILE: what is read");
}

TEST(Option, AWrongValueIsAnsweredWithTheRightOnes) {
  EXPECT_EQ(error_of(kJitter, "soon"),
            "option 'jitter': 'soon' is not valid; accepted: milliseconds, 0 to 1000000000");
  EXPECT_EQ(error_of(kLevel, "3"), "option 'level': '3' is not valid; accepted: a whole number, 0 to 2");
  EXPECT_EQ(error_of(kFlag, "maybe"), "option 'once': 'maybe' is not valid; accepted: on, off");
  EXPECT_EQ(error_of(kChoice, "evne"),
            "option 'parity': 'evne' is not valid; accepted: none, even, odd; did you mean 'even'?");
  EXPECT_EQ(error_of(kFlag, "a\nb\x1b"), "option 'once': 'a\\nb\\x1b' is not valid; accepted: on, off");
}

TEST(Option, AValueWithAUnitIsAnsweredWithoutIt) {
  const auto end_of = [](std::string_view value) {
    const std::string error = error_of(kJitter, value);
    return error.substr(error.rfind(';'));
  };
  EXPECT_EQ(end_of("100ms"), "; did you mean '100'?");
  EXPECT_EQ(end_of("0.5s"), "; did you mean '500'?");
  EXPECT_EQ(end_of("250us"), "; did you mean '0.25'?");
  EXPECT_EQ(end_of("-1s"), "; accepted: milliseconds, 0 to 1000000000");
  EXPECT_EQ(end_of("5 apples"), "; accepted: milliseconds, 0 to 1000000000");
  EXPECT_EQ(error_of(kPort, "5ms"),
            "option 'port': '5ms' is not valid; accepted: a whole number, 1 to 65535");
}

TEST(Option, AnUnknownOneIsAnsweredWithTheNearestOrWithAll) {
  const std::array options = {kJitter, kLevel, kFile};
  EXPECT_EQ(unknown_option("jiter", options, " of type x").message,
            "unknown option 'jiter' of type x; did you mean 'jitter'?");
  EXPECT_EQ(unknown_option("colour", options).message,
            "unknown option 'colour'; accepted: jitter, level, file");
}

TEST(HelpTable, LinesAreOfEightyCharactersAtMost) {
  const std::array rows = {
      HelpRow{"a", "short"}, HelpRow{"bb", std::string(30, 'x') + " " + std::string(60, 'y')},
      HelpRow{std::string(40, 'l'), "behind µ… a long one [which is not cut]"},
      HelpRow{"c", "to the end of the line and no more, this is the very last character [1 to 9]"}};
  EXPECT_EQ(help_table(rows),
            "  a   short\n"
            "  bb  " +
                std::string(30, 'x') +
                "\n"
                "      " +
                std::string(60, 'y') +
                "\n"
                "  " +
                std::string(40, 'l') +
                "\n"
                "      behind µ… a long one [which is not cut]\n"
                "  c   to the end of the line and no more, this is the very last character\n"
                "      [1 to 9]\n");
  EXPECT_EQ(test::first_long_line(help_table(rows)), "");
  EXPECT_EQ(help_text(std::string(50, 'a') + "\n" + std::string(28, 'b') + " c\nd", 2),
            std::string(50, 'a') + " " + std::string(28, 'b') + "\n  c d\n");
}

}  // namespace
}  // namespace porttape
