#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using test::TempDir;
using testing::HasSubstr;

TEST(Cat, ShowsBothDirectionsAndEventsInOrder) {
  const TempDir dir;
  const std::string tape =
      make_tape(dir, "t", {{1'002'000, "OK\r\n"}}, {{1'000'000, "AT\r"}},
                "{\"t_us\":0,\"event\":\"open\"}\n{\"t_us\":1001000,\"event\":\"mark\",\"text\":\"now\"}\n");
  const auto ran = run({"cat", tape});
  EXPECT_EQ(ran.status, 0);
  EXPECT_EQ(ran.out,
            "     0.000000  -  open\n"
            "     1.000000  w      3  \"AT\\r\"  41540d\n"
            "     1.001000  -  mark  \"text\":\"now\"\n"
            "     1.002000  r      4  \"OK\\r\\n\"  4f4b0d0a\n");
  EXPECT_EQ(ran.err, "");
}

TEST(Cat, JoinsBlocksLessThan500MicrosecondsApart) {
  const TempDir dir;
  const std::string tape =
      make_tape(dir, "t", {{0, "a"}, {499, "b"}, {999, "c"}, {1100, "d"}}, {{1050, "w"}});
  EXPECT_EQ(run({"cat", "--json", tape}).out,
            R"({"t_us":0,"until_us":499,"dir":"r","offset":0,"length":2,"blocks":2,"hex":"6162"})"
            "\n"
            R"({"t_us":999,"until_us":999,"dir":"r","offset":2,"length":1,"blocks":1,"hex":"63"})"
            "\n"
            R"({"t_us":1050,"until_us":1050,"dir":"w","offset":0,"length":1,"blocks":1,"hex":"77"})"
            "\n"
            R"({"t_us":1100,"until_us":1100,"dir":"r","offset":3,"length":1,"blocks":1,"hex":"64"})"
            "\n");
  EXPECT_EQ(run({"cat", "--json", "--dir", "r", tape}).out.find("\"dir\":\"w\""), std::string::npos);
  EXPECT_THAT(run({"cat", "--dir", "r", tape}).out,
              HasSubstr("     0.000999  r      1  \"c\"  63\n     0.001100"));
  EXPECT_THAT(run({"cat", "--blocks", tape}).out,
              testing::StartsWith("     0.000000  r      1  \"a\"  61\n"));
}

TEST(Cat, ShowsAPart) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{1'000'000, "a"}, {2'000'000, "b"}, {3'000'000, "c"}}, {});
  EXPECT_EQ(run({"cat", tape, "--from", "1.000001", "--to", "3"}).out,
            "     2.000000  r      1  \"b\"  62\n");
  EXPECT_EQ(run({"cat", tape, "--from=3"}).out, "     3.000000  r      1  \"c\"  63\n");
}

TEST(Cat, LongBlocksAreShortInTextAndWholeInJson) {
  const TempDir dir;
  const std::string big(700'000, 'x');
  const std::string tape = make_tape(dir, "t", {{0, "a"}, {1, big}, {2, "b"}}, {});
  const std::string text = run({"cat", tape}).out;
  EXPECT_LT(text.size(), 400U);
  EXPECT_THAT(text, HasSubstr("r 700000  \"xxxxxxxx"));
  EXPECT_THAT(run({"cat", "--json", tape}).out, HasSubstr("\"hex\":\"" + to_hex(as_bytes(big)) + "\"}\n"));
}

TEST(Cat, NothingOnATapeReachesATerminalRaw) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{0, "\x1b[31m\x07"}}, {},
                                     "{\"t_us\":1,\"event\":\"x\xc2\x9b\",\"a\":\"\x7f\xff\"}\n");
  const std::string text = run({"cat", tape}).out;
  for (const char c : text) EXPECT_TRUE(c == '\n' || (static_cast<Byte>(c) >= 0x20 && c != 0x7F)) << text;
  EXPECT_EQ(text.find("\xc2\x9b"), std::string::npos);
}

TEST(Cat, PrintsAllBeforeTheDamageAndFails) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{5000, "kept"}, {1000, "bad"}}, {});
  const auto ran = run({"cat", tape});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out, HasSubstr("kept"));
  EXPECT_THAT(ran.err, HasSubstr("damaged at offset 16"));
}

TEST(Cat, ATornTailIsANote) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{1, "abc"}}, {});
  test::write_file(tape + "w", test::bytes_of(std::string("\0\0\0", 3)));
  const auto ran = run({"cat", tape});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.err, HasSubstr("porttape cat: note: " + tape + "w: torn tail at offset 0"));
}

TEST(Cat, BadArgumentsAreOneLineAndExit2) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {}, {});
  const std::vector<std::vector<std::string>> wrong{{"cat"},
                                                    {"cat", tape, tape},
                                                    {"cat", tape, "--fro", "1"},
                                                    {"cat", tape, "--from", "x"},
                                                    {"cat", tape, "--from", "-1"},
                                                    {"cat", tape, "--to", "nan"},
                                                    {"cat", tape, "--to", "1s"},
                                                    {"cat", tape, "--dir", "x"},
                                                    {"cat", tape, "--from"},
                                                    {"cat", tape, "--blocks=1"}};
  for (const auto& args : wrong) {
    const auto ran = run(args);
    EXPECT_EQ(ran.status, 2) << ran.err;
    EXPECT_THAT(ran.err, testing::MatchesRegex("porttape cat: [^\n]*(; see porttape cat --help|[?])\n"));
    EXPECT_EQ(ran.out, "");
  }
  EXPECT_EQ(run({"cat", dir / "none"}).status, 2);
}

TEST(Cat, NothingOfAForeignEventIsObeyedByATerminal) {
  const TempDir dir;
  const std::string tape = make_tape(
      dir, "t", {}, {}, "{\"t_us\":1,\"event\":\"mark\",\"text\":\"\u009b31m\x7f\u202e\xc3\xa9\"}\n");
  for (const char* form : {"--blocks", "--json"}) {
    const auto ran = run({"cat", tape, form});
    EXPECT_EQ(ran.status, 0) << ran.err;
    for (const char* obeyed : {"\u009b", "\x7f", "\u202e"})
      EXPECT_THAT(ran.out, testing::Not(HasSubstr(obeyed)));
    EXPECT_THAT(ran.out, HasSubstr("\xc3\xa9"));
  }
}

}  // namespace
}  // namespace porttape
