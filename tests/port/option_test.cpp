#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/port/help_table.hpp"
#include "libport/port/port_options.hpp"
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

TEST(Option, ANumberMayBeEitherEndOfItsRange) {
  EXPECT_EQ(error_of(kLevel, "0"), "good");
  EXPECT_EQ(error_of(kLevel, "2"), "good");
  EXPECT_NE(error_of(kPort, "0"), "good");
  EXPECT_EQ(error_of(kPort, "1"), "good");
  EXPECT_EQ(error_of(kPort, "65535"), "good");
  EXPECT_NE(error_of(kPort, "65536"), "good");
  EXPECT_EQ(error_of(kJitter, "1000000000"), "good");
  EXPECT_NE(error_of(kJitter, "-0.1"), "good");
}

TEST(Option, ANumberIsWholeWhereItCountsSomethingAndHasNoExponent) {
  EXPECT_NE(error_of(kLevel, "1.5"), "good");
  EXPECT_EQ(error_of(kLevel, "1.0"), "good");
  EXPECT_EQ(error_of(kJitter, "1.5"), "good");
  for (const char* const wrong : {"1e3", "inf", "nan", "", " 1", "1 ", "0x1"})
    EXPECT_NE(error_of(kJitter, wrong), "good") << wrong;
}

TEST(Option, AFlagHasFourWordsForEachOfItsStates) {
  for (const char* const on : {"1", "on", "yes", "true"})
    EXPECT_EQ(check_value(kFlag, on).value(), "1") << on;
  for (const char* const off : {"0", "off", "no", "false"})
    EXPECT_EQ(check_value(kFlag, off).value(), "") << off;
  const std::array options = {kFlag};
  EXPECT_TRUE(check_values(options, {{"once", "off"}}, "")->empty()) << "as if it were not there";
  EXPECT_EQ(check_values(options, {{"once", "on"}}, "")->at("once"), "1");
}

TEST(Option, UpToFourNumbersAreEachTold) {
  EXPECT_EQ(value_name({"four", Kind::integer, "", "", 1, 4}), "1|2|3|4");
  EXPECT_EQ(value_name({"five", Kind::integer, "", "", 1, 5}), "N");
  EXPECT_EQ(value_name({"some", Kind::number, "", "", 1, 2}), "N");
  EXPECT_EQ(value_name({"text"}), "TEXT");
  EXPECT_EQ(value_name({.name = "wait", .kind = Kind::number, .unit = "s"}), "SEC");
  EXPECT_EQ(value_name({.name = "wait", .kind = Kind::number, .unit = "us"}), "US");
}

TEST(Option, ARangeWithoutALimitHasNoUpperEnd) {
  const auto help = [](double max) {
    return help_of({.name = "n", .kind = Kind::integer, .help = "many", .min = 2, .max = max});
  };
  EXPECT_EQ(help(1e9), "many [2 or more]");
  EXPECT_EQ(help(1e9 - 1), "many [2 to 999999999]");
  EXPECT_EQ(accepted_by({.name = "n", .kind = Kind::number, .max = 1e15}), "a number, 0 or more");
  EXPECT_EQ(accepted_by({.name = "n", .kind = Kind::integer, .max = 1e14}),
            "a whole number, 0 to 100000000000000");
}

TEST(Option, UnitsHaveSeveralNames) {
  const OptionSpec seconds{.name = "wait", .kind = Kind::number, .max = 1e9, .unit = "s"};
  const auto meant = [&seconds](std::string_view value) {
    const std::string error = error_of(seconds, value);
    return error.substr(error.rfind(';'));
  };
  EXPECT_EQ(meant("2min"), "; did you mean '120'?");
  EXPECT_EQ(meant("2sec"), "; did you mean '2'?");
  EXPECT_EQ(meant("1500ms"), "; did you mean '1.5'?");
  EXPECT_EQ(meant("5µs"), "; did you mean '0.000005'?");
}

TEST(HelpTable, ALeftColumnIsAtMostTwentyFourWide) {
  const std::array fits = {HelpRow{std::string(24, 'a'), "x"}, HelpRow{"b", "y"}};
  EXPECT_EQ(help_table(fits), "  " + std::string(24, 'a') + "  x\n  b" + std::string(25, ' ') + "y\n");
  const std::array wide = {HelpRow{std::string(25, 'a'), "x"}, HelpRow{"b", "y"}};
  EXPECT_EQ(help_table(wide), "  " + std::string(25, 'a') + "\n     x\n  b  y\n");
}

TEST(HelpTable, ALineOfEightyCharactersIsNotWrapped) {
  EXPECT_EQ(help_text(std::string(40, 'a') + ' ' + std::string(39, 'b'), 2),
            std::string(40, 'a') + ' ' + std::string(39, 'b') + '\n');
  EXPECT_EQ(help_text(std::string(40, 'a') + ' ' + std::string(40, 'b'), 2),
            std::string(40, 'a') + "\n  " + std::string(40, 'b') + '\n');
  EXPECT_EQ(help_text("a  ", 2), "a\n");
}

TEST(Option, AnUnknownOneIsAnErrorOfUse) { EXPECT_EQ(unknown_option("x", {}).code, Errc::usage); }

TEST(Option, ALimitThatNobodyReachesIsNotToldWithAUnitEither) {
  EXPECT_EQ(accepted_by({.name = "n", .kind = Kind::number, .max = 1e15, .unit = "s"}), "seconds, 0 or more");
  EXPECT_EQ(accepted_by({.name = "n", .kind = Kind::integer, .max = 9, .unit = "ms"}),
            "whole milliseconds, 0 to 9");
}

// "5 6 7 8": those of these values that the option takes.
std::string taken(std::span<const OptionSpec> options, std::string_view name,
                  const std::vector<std::string>& values) {
  std::string out;
  for (const std::string& value : values) {
    const auto option = std::ranges::find(options, name, &OptionSpec::name);
    if (option != options.end() && check_value(*option, value)) out += (out.empty() ? "" : " ") + value;
  }
  return out;
}

TEST(LineSettingOptions, TakeWhatALineCanBe) {
  const std::vector<OptionSpec> options = line_setting_options();
  EXPECT_EQ(taken(options, "baud", {"0", "1", "9600.5", "4294967295", "4294967296"}), "1 4294967295");
  EXPECT_EQ(taken(options, "databits", {"4", "5", "7.5", "8", "9"}), "5 8");
  EXPECT_EQ(taken(options, "stopbits", {"0", "1", "1.5", "2", "3"}), "1 2");
  EXPECT_EQ(taken(options, "parity", {"none", "even", "odd", "mark", ""}), "none even odd");
  EXPECT_EQ(taken(options, "hwflowctrl", {"on", "2"}), "on");
  EXPECT_EQ(taken(options, "swflowctrl", {"on", "2"}), "on");
}

TEST(PortTypesTest, AListeningSpellingIsOneOfThoseThatAreMeant) {
  PortType tcp{"tcp", {"host"}, "a connection"};
  tcp.listening = {"port"};
  const PortTypes types({tcp, PortType{"serial", {"device"}, "a tty"}});
  EXPECT_EQ(types.spellings(), (std::vector<std::string>{"tcp", "tcp-listen", "serial"}));
  EXPECT_EQ(parse_options(types, "type=tcp-listn").error().message,
            "port 'type=tcp-listn': unknown type 'tcp-listn'; did you mean 'tcp-listen'?");
}

TEST(LineSettingOptions, AreReadIntoALine) {
  PortType type{"serial", {"device"}, "a tty"};
  type.options = line_setting_options();
  const PortTypes types({type});
  const auto line = [&types](const std::string& spelled) {
    return line_settings(parse_options(types, spelled).value());
  };
  EXPECT_EQ(line("type=serial"), LineSettings{});
  EXPECT_EQ(line("type=serial,parity=even").parity, Parity::even);
  EXPECT_EQ(line("type=serial,parity=odd").parity, Parity::odd);
  EXPECT_EQ(line("type=serial,parity=none").parity, Parity::none);
  EXPECT_EQ(
      line("type=serial,baud=250000,databits=7,stopbits=2,hwflowctrl,swflowctrl"),
      (LineSettings{.baud = 250'000, .data_bits = 7, .stop_bits = 2, .hw_flow = true, .sw_flow = true}));
}

TEST(CommonOptionsOfPorts, TakeWhatFlexiportsDo) {
  const std::vector<OptionSpec> options = with_common({});
  EXPECT_EQ(taken(options, "debug", {"-1", "0", "1.5", "9", "10"}), "0 9");
  EXPECT_EQ(taken(options, "timeout", {"-2", "-1", "0.5", "1000000000", "1000000001"}), "-1 0.5 1000000000");
  for (const char* const flag : {"readonly", "writeonly", "readwrite", "alwaysopen"})
    EXPECT_EQ(taken(options, flag, {"on", "2"}), "on") << flag;
}

TEST(HelpTable, CharactersCountAndNotTheirBytes) {
  const std::string line = std::string(40, 'a') + ' ' + std::string(37, 'b') + "µ…";
  EXPECT_EQ(help_text(line, 2), line + '\n') << "80 characters";
}

TEST(HelpTable, WhereAllIsWideTheTextIsIndentedByTwiceTwo) {
  const std::array wide = {HelpRow{std::string(25, 'a'), "x"}};
  EXPECT_EQ(help_table(wide), "  " + std::string(25, 'a') + "\n    x\n");
}

}  // namespace
}  // namespace porttape
