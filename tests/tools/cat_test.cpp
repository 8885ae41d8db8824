#include <algorithm>
#include <csignal>
#include <fcntl.h>
#include <sstream>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tape/new_tape.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tests/tools/run.hpp"
#include "tools/follow.hpp"
#include "tools/output.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using test::TempDir;
using testing::HasSubstr;
using testing::StartsWith;

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

TEST(Cat, ShowsSettingsInTheirPlaceAndInWords) {
  const TempDir dir;
  const std::string line = R"({"t_us":1000,"event":"settings","by":"driver","baud":300,"stopbits":2,)"
                           R"("hwflowctrl":false,"order":"sampled","newer":1})";
  const std::string tape = make_tape(dir, "t", {{999, "a"}}, {{1001, "b"}}, line + "\n");
  EXPECT_EQ(run({"cat", tape}).out,
            "     0.000999  r      1  \"a\"  61\n"
            "     0.001000  -  settings  driver: 300 baud, 2 stop bits (sampled)\n"
            "     0.001001  w      1  \"b\"  62\n");
  EXPECT_THAT(run({"cat", "--json", tape}).out, HasSubstr(line + "\n"));
}

TEST(Cat, ShowsSignalsInTheirPlaceAndInWords) {
  const TempDir dir;
  const std::string lines = R"({"t_us":1000,"event":"modem","line":"rts","state":"off","by":"driver"})"
                            "\n"
                            R"({"t_us":1000,"event":"break","state":"on","by":"device"})"
                            "\n"
                            R"({"t_us":1500,"event":"drain","took_us":480})"
                            "\n"
                            R"({"t_us":1600,"event":"modem","line":"dcd","state":"on"})"
                            "\n";
  const std::string tape = make_tape(dir, "t", {{999, "a"}}, {{1001, "b"}}, lines);
  EXPECT_EQ(run({"cat", tape}).out,
            "     0.000999  r      1  \"a\"  61\n"
            "     0.001000  -  modem  driver: rts off\n"
            "     0.001000  -  break  device: on\n"
            "     0.001001  w      1  \"b\"  62\n"
            "     0.001500  -  drain  \"took_us\":480\n"
            "     0.001600  -  modem  \"line\":\"dcd\",\"state\":\"on\"\n");
  EXPECT_THAT(run({"cat", "--json", tape}).out, HasSubstr(lines.substr(0, lines.find('\n') + 1)));
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

TEST(Cat, WhatItsEndDoesNotTellOfIsPrintedAndThenAnError) {
  const TempDir dir;
  const std::string end =
      R"({"t_us":3000,"event":"end","read":{"blocks":2,"bytes":2},"write":{"blocks":0,"bytes":0}})"
      "\n";
  const std::string tape = make_tape(dir, "t", {{1'000, "a"}}, {}, end);
  const auto ran = run({"cat", tape, "--blocks"});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out, StartsWith("     0.001000  r      1  \"a\"  61\n     0.003000  -  end"));
  EXPECT_THAT(ran.err, HasSubstr("t.logr is shortened, or another tape's"));
  EXPECT_THAT(ran.err, HasSubstr("porttape recover TAPE -o NAME"));
}

TEST(Cat, ShowsWhatIsLookedFor) {
  const test::TempDir dir;
  const std::string tape =
      make_tape(dir, "t", {{2'000, "OK\r\n"}, {4'000, "ERROR 7\r\n"}}, {{1'000, "AT\r"}, {3'000, "AT+X\r"}},
                "{\"t_us\":2500,\"event\":\"mark\",\"text\":\"an ERROR is near\"}\n");
  EXPECT_EQ(run({"cat", tape, "--find", "ERROR|\\+"}).out,
            "     0.002500  -  mark  \"text\":\"an ERROR is near\"\n"
            "     0.003000  w      5  \"AT+X\\r\"  41542b580d\n"
            "     0.004000  r      9  \"ERROR 7\\r\\n\"  4552524f5220370d0a\n");
  EXPECT_EQ(run({"cat", tape, "--find", "\\x41T\\r", "--dir", "w", "--as", "hex"}).out,
            "     0.001000  w      3  41540d\n");
  EXPECT_THAT(run({"cat", tape, "--find", "^mark$"}).out, HasSubstr("an ERROR is near"));
  EXPECT_EQ(run({"cat", tape, "--find", "text|t_us|2500"}).out, "");
}

TEST(Cat, OfLargeBlocksThePiecesInWhichItIsFound) {
  const test::TempDir dir;
  std::string large(300'000, 'a');
  large[250'000] = 'X';
  const std::string tape = make_tape(dir, "t", {{2'000, large}}, {});
  const auto ran = run({"cat", tape, "--find", "X", "--json"});
  EXPECT_EQ(std::count(ran.out.begin(), ran.out.end(), '\n'), 1);
  EXPECT_THAT(ran.out, HasSubstr("58"));
}

TEST(Cat, TimesSinceTheLineBeforeAndOfTheDay) {
  const test::TempDir dir;
  const std::string tape = make_tape(dir, "t", {{2'000, "OK"}}, {{1'500, "AT"}});
  EXPECT_EQ(run({"cat", tape, "--time", "delta", "--as", "text"}).out,
            "    +0.001500  w      2  \"AT\"\n"
            "    +0.000500  r      2  \"OK\"\n");
  const auto none = run({"cat", tape, "--time", "wall"});
  EXPECT_EQ(none.status, 2);
  EXPECT_THAT(none.err, HasSubstr("does not tell when it was recorded"));
  TapeHeader header;
  header.zero = TapeZero{"2026-11-24T01:02:03.000000Z", 0, ""};
  auto made = NewTape::create(literal_tape(dir / "w.log"), header, {.sync = false});
  ASSERT_TRUE(made);
  ASSERT_TRUE(made->block(Direction::write, tape_time_us(1'500'000), test::bytes_of("AT")));
  ASSERT_TRUE(made->finish(made->latest()));
  EXPECT_THAT(run({"cat", dir / "w.log", "--time", "wall"}).out,
              StartsWith("2026-11-24T01:02:04.500000Z  w      2  \"AT\"  4154\n"));
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

TEST(Cat, WhatIsSoundOfATapeWithADamagedEventsFileIsPrinted) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{1000, "before"}, {9000, "after"}}, {{3000, "ask"}},
                                     "{\"t_us\":0,\"event\":\"open\"}\nno event\n");
  const auto ran = run({"cat", tape});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out, HasSubstr("open\n"));
  for (const char* text : {"before", "ask", "after"}) EXPECT_THAT(ran.out, HasSubstr(text));
  EXPECT_THAT(ran.err, HasSubstr("t.loge is damaged in line 3: not a JSON object"));

  test::write_file(tape + "e", as_bytes("no header\n"));
  const auto headless = run({"cat", tape});
  EXPECT_EQ(headless.status, 1);
  for (const char* text : {"before", "ask", "after"}) EXPECT_THAT(headless.out, HasSubstr(text));
  EXPECT_THAT(headless.err, HasSubstr("is not an events file"));
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

class CatWidth : public testing::Test {
 protected:
  ~CatWidth() override { ::unsetenv("COLUMNS"); }
  static test::Ran cat_at(const char* columns, std::vector<std::string> args) {
    ::setenv("COLUMNS", columns, 1);
    args.insert(args.begin(), "cat");
    return run(args);
  }
};

TEST_F(CatWidth, LongLinesAreCutToTheWidthAndSaySo) {
  const TempDir dir;
  const std::string tape =
      make_tape(dir, "t", {{0, std::string(300, 'x')}, {1'000'000, "\x01\x02"}}, {},
                "{\"t_us\":500000,\"event\":\"mark\",\"text\":\"" + std::string(300, 'y') + "\"}\n");
  for (const char* columns : {"60", "80", "81", "82", "83", "200"}) {
    const auto lines = lines_of(cat_at(columns, {tape}).out);
    ASSERT_EQ(lines.size(), 3U);
    const std::size_t width = std::stoul(columns);
    EXPECT_LE(lines[0].size(), width);
    EXPECT_GT(lines[0].size() + 3, width);
    EXPECT_THAT(lines[0], testing::EndsWith("78..."));
    EXPECT_EQ(lines[1].size(), width);
    EXPECT_THAT(lines[1], testing::EndsWith("yyy..."));
    EXPECT_THAT(lines[2], testing::EndsWith("\"\\x01\\x02\"  0102"));
  }
  // What just fits is not cut: 25 columns in front, 4 around, 3 a byte.
  const std::string fits = make_tape(dir, "u", {{0, "abcdefgh"}}, {});
  EXPECT_THAT(cat_at("53", {fits}).out, testing::EndsWith("\"abcdefgh\"  6162636465666768\n"));
  EXPECT_THAT(cat_at("52", {fits}).out, HasSubstr("..."));
  EXPECT_EQ(lines_of(cat_at("1", {fits}).out).size(), 1U);
}

TEST_F(CatWidth, FullShowsEveryByteInRowsOfTheWidth) {
  const TempDir dir;
  std::string all;
  for (int n = 0; n < 1024; ++n) all += static_cast<char>(n);
  const std::string tape = make_tape(dir, "t", {{0, all}, {1'000'000, std::string(300'000, 'x')}}, {});
  for (const char* columns : {"1", "60", "80", "133"}) {
    const auto ran = cat_at(columns, {"--full", tape});
    std::string hex;
    for (const std::string& line : lines_of(ran.out)) {
      const std::size_t width = std::stoul(columns);
      EXPECT_TRUE(width == 1 || line.size() <= width) << line;
      hex += line.substr(line.rfind(' ') + 1);
    }
    EXPECT_EQ(hex, to_hex(as_bytes(all + std::string(300'000, 'x'))));
  }
  const auto row = lines_of(cat_at("60", {"--full", tape}).out)[1];
  EXPECT_THAT(row, testing::StartsWith(std::string(25, ' ') + '"'));
}

TEST(CatColor, EachDirectionHasItsOwnWhenAskedFor) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{2000, "r"}}, {{1000, "w"}});
  const auto lines = lines_of(run({"cat", tape, "--color", "always"}).out);
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_THAT(lines[0], HasSubstr("\x1b[36mw"));
  EXPECT_THAT(lines[1], HasSubstr("\x1b[32mr"));
  EXPECT_THAT(lines[1], testing::EndsWith("\x1b[0m"));
  for (const std::vector<std::string>& plain : {std::vector<std::string>{"cat", tape},
                                                {"cat", tape, "--color", "never"},
                                                {"info", tape},
                                                {"verify", tape}})
    EXPECT_EQ(run(plain).out.find('\x1b'), std::string::npos);
  for (const char* verb : {"info", "verify"})
    EXPECT_THAT(run({verb, tape, "--color=always"}).out,
                HasSubstr("\x1b[33mno damage found, as far as it can be checked\x1b[0m"))
        << verb;
  EXPECT_EQ(run({"cat", tape, "--color", "maybe"}).status, 2);
}

// Reads a tape while a recorder writes it.
class CatFollow : public testing::Test {
 protected:
  CatFollow() : paths(literal_tape(dir / "t.log")) {
    TapeHeader header;
    header.id = "0123";
    auto made = TapeWriter::create(paths, header, {.sync = false});
    writer = std::move(*made);
    writer->event(tape_time_us(0), event::Open{});
    writer->write_block(tape_time_us(1000), as_bytes("ask"));
  }
  void follow() {
    int ends[2];
    ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
    reader = UniqueFd(ends[0]);
    thread = std::thread([this, fd = ends[1]] {
      const UniqueFd out_fd(fd);
      FdStreambuf buffer(fd);
      std::ostream out(&buffer);
      const std::vector<std::string> args = {"cat", "--follow", paths.name()};
      status = run_porttape(args, out, err);
      out.flush();
    });
  }
  // The next line; empty at the end.
  std::string line() {
    std::string text;
    char c = 0;
    while (::read(reader.get(), &c, 1) == 1 && c != '\n') text += c;
    return text;
  }
  ~CatFollow() override {
    if (thread.joinable()) thread.join();
  }

  TempDir dir;
  TapePaths paths;
  std::optional<TapeWriter> writer;
  UniqueFd reader;
  std::ostringstream err;
  int status = -1;
  std::thread thread;
};

TEST_F(CatFollow, ShowsWhatComesUntilTheTapeEnds) {
  follow();
  EXPECT_THAT(line(), HasSubstr("open"));
  EXPECT_THAT(line(), HasSubstr("ask"));
  for (int n = 2; n < 6; ++n) {
    writer->read_block(tape_time_us(n * 1000), as_bytes("answer " + std::to_string(n)));
    EXPECT_THAT(line(), HasSubstr("answer " + std::to_string(n)));
  }
  writer->event(tape_time_us(7000), event::Mark{"here"});
  EXPECT_THAT(line(), HasSubstr("here"));
  ASSERT_TRUE(writer->finish(tape_time_us(8000)));
  EXPECT_THAT(line(), HasSubstr("end"));
  EXPECT_EQ(line(), "");
  thread.join();
  EXPECT_EQ(status, 0);
  EXPECT_EQ(err.str(), "");
}

TEST_F(CatFollow, NamesTheTapeThatGoesOn) {
  follow();
  EXPECT_THAT(line(), HasSubstr("open"));
  EXPECT_THAT(line(), HasSubstr("ask"));
  TapeHeader next;
  next.previous = PreviousTape{"0123", "t.log"};
  auto part = TapeWriter::create(literal_tape(dir / "t.2.log"), next, {.sync = false});
  ASSERT_TRUE(part);
  ASSERT_TRUE(writer->finish(tape_time_us(8000)));
  thread.join();
  EXPECT_EQ(status, 0);
  EXPECT_THAT(err.str(), HasSubstr("note: it goes on as " + (dir / "t.2.log")));
}

// A tape of a boot; the first began at 10 s, this one so much later.
void make_of_boot(const TempDir& dir, const char* name, Micros later, const std::vector<std::string>& said,
                  const std::string& boot = "b") {
  TapeHeader header;
  header.id = name;
  const TapeZero first{"2024-05-06T07:08:09.000000Z", 10'000'000, boot};
  header.zero = porttape::later(first, later);
  auto tape = NewTape::create(literal_tape(dir / name), header, {.sync = false});
  ASSERT_TRUE(tape);
  ASSERT_TRUE(tape->event(TapeTime{}, event::Open{}));
  TapeTime at{};
  for (const std::string& text : said) {
    at += Micros(1000);
    ASSERT_TRUE(tape->block(Direction::write, at, as_bytes(text)));
  }
  ASSERT_TRUE(tape->finish(at + Micros(1)));
}

TEST(CatGroup, ShowsSeveralTapesOnOneTime) {
  const TempDir dir;
  make_of_boot(dir, "t.log", Micros{}, {"a", "b", "c"});
  make_of_boot(dir, "t.c2.log", Micros(1500), {"x"});
  const auto ran = run({"cat", dir / "t.c2.log", dir / "t.log", "--as", "text"});
  EXPECT_EQ(ran.err, "");
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.out, StartsWith("     0.000000  t.log     -  open\n"
                                  "     0.001000  t.log     w      1  \"a\"\n"
                                  "     0.001500  t.c2.log  -  open\n"
                                  "     0.002000  t.log     w      1  \"b\"\n"
                                  "     0.002500  t.c2.log  w      1  \"x\"\n"));
  EXPECT_THAT(ran.out, HasSubstr("     0.003000  t.log     w      1  \"c\"\n"));
  EXPECT_THAT(
      run({"cat", dir / "t.log", dir / "t.c2.log", "--dir", "w", "--from", "0.002", "--time", "wall"}).out,
      HasSubstr("2024-05-06T07:08:09.002500Z  t.c2.log  w      1  \"x\""));
  const std::string json = run({"cat", dir / "t.log", dir / "t.c2.log", "--json"}).out;
  EXPECT_THAT(json, HasSubstr("{\"tape\":\"t.c2.log\",\"t_us\":1500,\"event\":\"open\"}\n"));
  EXPECT_THAT(json, HasSubstr("{\"tape\":\"t.c2.log\",\"t_us\":2500,\"until_us\":2500,\"dir\":\"w\","));
}

TEST(CatGroup, DamageOfOneTapeEndsThatOneAlone) {
  const TempDir dir;
  make_of_boot(dir, "t.log", Micros{}, {"a", "b", "c"});
  make_of_boot(dir, "u.log", Micros(500), {"x", "y"});
  Bytes bad = test::read_file(dir / "t.logw");
  bad.at(bad.size() / 2) ^= 0xff;  // the head of the second block
  test::write_file(dir / "t.logw", bad);
  const auto ran = run({"cat", dir / "t.log", dir / "u.log", "--as", "text"});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.err, HasSubstr("t.logw is damaged"));
  EXPECT_THAT(ran.out, HasSubstr("u.log  w      1  \"y\"\n"));
}

TEST(CatGroup, TapesWithoutACommonTimeAreRefused) {
  const TempDir dir;
  make_of_boot(dir, "t.log", Micros{}, {"a"});
  make_of_boot(dir, "u.log", Micros{}, {"b"}, "another");
  const auto apart = run({"cat", dir / "t.log", dir / "u.log"});
  EXPECT_EQ(apart.status, 2);
  EXPECT_THAT(apart.err, HasSubstr("common time"));
  EXPECT_EQ(run({"cat", dir / "t.log", dir / "t.log"}).status, 2);
  EXPECT_THAT(run({"cat", dir / "t.log", dir / "u.log", "--follow"}).err,
              HasSubstr("--follow takes one tape"));
}

TEST(CatFollowGroup, FindsTheNextPartOfEachConnection) {
  const TempDir dir;
  const auto make = [&](const char* name, const std::string& id, const std::string& before) {
    TapeHeader header;
    header.id = id;
    if (!before.empty()) header.previous = PreviousTape{before, "before.log"};
    auto part = TapeWriter::create(literal_tape(dir / name), header, {.sync = false});
    ASSERT_TRUE(part);
    ASSERT_TRUE(part->finish(tape_time_us(8000)));
  };
  make("t.log", "a1", "");
  make("t.c2.log", "b1", "");
  make("t.2.log", "a2", "a1");
  make("t.2.c2.log", "b2", "b1");
  make("t.3.c2.log", "b3", "b2");
  const auto next = [&](const char* name, const char* id) {
    return next_part(literal_tape(dir / name), id, Nanos::zero());
  };
  EXPECT_EQ(next("t.log", "a1"), dir / "t.2.log");
  EXPECT_EQ(next("t.c2.log", "b1"), dir / "t.2.c2.log");
  EXPECT_EQ(next("t.2.c2.log", "b2"), dir / "t.3.c2.log");
  EXPECT_EQ(next("t.3.c2.log", "b3"), std::nullopt);
}

TEST_F(CatFollow, EndsWhenNobodyWritesTheTape) {
  follow();
  EXPECT_THAT(line(), HasSubstr("open"));
  EXPECT_THAT(line(), HasSubstr("ask"));
  // As a killed recorder leaves it: what is there stays, the locks go.
  const Bytes events = test::read_file(paths.events);
  writer.reset();
  thread.join();
  EXPECT_EQ(status, 0);
  test::write_file(paths.events, events);
  const auto ran = run({"cat", "--follow", paths.name()});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.err, HasSubstr("nobody writes this tape; it has no end"));
}

TEST_F(CatFollow, EndsWhenNobodyReadsIt) {
  follow();
  EXPECT_THAT(line(), HasSubstr("open"));
  ::signal(SIGPIPE, SIG_IGN);
  reader.reset();
  thread.join();
  EXPECT_EQ(status, 0);
}

TEST(CatFollowNothing, SaysThatThereIsNoTapeYet) {
  const TempDir dir;
  const auto ran = run({"cat", "--follow", dir / "none"});
  EXPECT_EQ(ran.status, 2);
  EXPECT_THAT(ran.err, HasSubstr("a tape begins when a driver first opens the port"));
}

}  // namespace
}  // namespace porttape
