#include "libport/base/printable.hpp"

#include <string>

#include <gtest/gtest.h>

#include "libport/base/json_text.hpp"

namespace porttape {
namespace {

TEST(PrintableLine, NamesStayReadable) {
  EXPECT_EQ(printable_line("Gerät №1 \"x\\y\" 測定"), "Gerät №1 \"x\\y\" 測定");
}

TEST(PrintableLine, ControlsAreEscaped) {
  EXPECT_EQ(printable_line("a\x1b[31m\n\t\x7f"), "a\\x1b[31m\\n\\t\\x7f");
  EXPECT_EQ(printable_line("\u0080\u009b31m\u009f\u00a0"), "\\x80\\x9b31m\\x9f\u00a0");
}

TEST(PrintableLine, BytesThatAreNoUtf8AreEscaped) {
  EXPECT_EQ(printable_line("\x9b"
                           "31m\xff\xc3"),
            "\\x9b31m\\xff\\xc3");
}

TEST(PrintableLine, MarksOfDirectionAndSeparatorsAreEscaped) {
  for (const char* mark :
       {"\u061c", "\u200e", "\u200f", "\u2028", "\u2029", "\u202a", "\u202e", "\u2066", "\u2069"}) {
    EXPECT_TRUE(printable_line(mark).starts_with("\\u{")) << mark;
    EXPECT_TRUE(json_quote(mark).starts_with("\"\\u")) << mark;
  }
  EXPECT_EQ(printable_line("a\u202eb"), "a\\u{202e}b");
  EXPECT_EQ(printable_line("\u2027\u202f"), "\u2027\u202f");
}

TEST(PrintableLines, LinesAreKeptAndNoneBeginsAtTheFront) {
  EXPECT_EQ(printable_lines("one\n  two\nthree\x1b\n"), "one\n  two\n  three\\x1b\n");
}

TEST(InQuotes, IsOneLineWithinQuotes) {
  EXPECT_EQ(in_quotes("/tmp/ä€📼"), "'/tmp/ä€📼'");
  EXPECT_EQ(in_quotes("a\nb\x1b\xff"), "'a\\nb\\x1b\\xff'");
  EXPECT_EQ(in_quotes(""), "''");
}

TEST(ShellWord, IsInQuotesWhereAShellNeedsThem) {
  EXPECT_EQ(shell_word("/dev/ttyUSB0,baud=9600"), "/dev/ttyUSB0,baud=9600");
  EXPECT_EQ(shell_word("{port}"), "{port}");
  EXPECT_EQ(shell_word("--to={port},x"), "'--to={port},x'");
  EXPECT_EQ(shell_word("{a,--,touch,b}"), "'{a,--,touch,b}'");
  EXPECT_EQ(shell_word("{1..9}"), "'{1..9}'");
  EXPECT_EQ(shell_word("a b"), "'a b'");
  EXPECT_EQ(shell_word("it's"), "'it'\\''s'");
  EXPECT_EQ(shell_word("$HOME"), "'$HOME'");
  EXPECT_EQ(shell_word(""), "''");
}

TEST(JsonQuote, EscapesWhatATerminalObeys) {
  EXPECT_EQ(json_quote("\x1b\x7f\u009bé\u202e\xff"), "\"\\u001b\\u007f\\u009bé\\u202e\uFFFD\"");
}

TEST(JsonForTerminal, StaysTheSameJson) {
  EXPECT_EQ(json_for_terminal("{\"a\":\t\"\u009b31m\x7fé\"}\r"), "{\"a\": \"\\u009b31m\\u007fé\"} ");
}

}  // namespace
}  // namespace porttape
