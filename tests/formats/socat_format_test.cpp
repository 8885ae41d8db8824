#include "libport/formats/socat_format.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::told_lines;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// As socat 1.7.4.4 writes them.
constexpr const char* kSocatHex =
    "> 2026/11/23 21:53:11.000574823  length=21 from=0 to=20\n"
    " 61 09 62 0d 0a 63 5c 64 00 01 ff 22 2d 2d 0a 2d 2d 0a 78 79 7a\n"
    "< 2026/11/23 21:53:11.000576053  length=2 from=0 to=1\n 61 09\n";
constexpr const char* kSocatBoth =
    "> 2026/11/23 21:53:12.000662600  length=21 from=0 to=20\n"
    " 61 09 62 0d 0a                                   a.b..\n"
    " 63 5c 64 00 01 ff 22 2d 2d 0a                    c\\d...\"--.\n"
    " 2d 2d 0a                                         --.\n"
    " 78 79 7a                                         xyz\n"
    "--\n"
    "2026/11/23 21:53:12 socat[123] N socket 1 (fd 0) is at EOF\n"
    "< 2026/11/23 21:53:12.000664183  length=17 from=0 to=16\n"
    " 31 32 33 34 35 36 37 38 39 30 31 32 33 34 35 36  1234567890123456\n"
    " 20                                                \n--\n";
constexpr const char* kSocatText =
    "> 2026/11/23 21:53:12.000143505  length=19 from=0 to=18\na\tb\\r\nc\\\\d..\n--\n"
    "xyz12< 2026/11/23 21:53:12.000143620  length=3 from=0 to=2\nok\n";

class SocatFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> import(const std::string& log, const ImportOptions& options = {},
                              std::string_view format = "socat-x") {
    return test::imported(dir, "t" + std::to_string(++made_), format, log, options);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(SocatFormatTest, TimesThatGoBackAreToldWithTheirLines) {
  const auto made = import(
      "> 2026/11/23 21:53:11.000100  length=1 from=0 to=0\n 61\n"
      "< 2026/11/23 19:53:11.000600  length=2 from=0 to=1\n 61\n 09\n"
      "> 2026/11/23 19:53:12.000100  length=1 from=1 to=1\n 61\n");
  EXPECT_THAT(made->problems, ElementsAre(HasSubstr("lines 3 and 6: the time goes back; ")));
}

TEST_F(SocatFormatTest, HexTextAndBoth) {
  EXPECT_THAT(told_lines(import(kSocatHex)),
              ElementsAre("w 0 a\\tb\\r\\nc\\\\d\\x00\\x01\\xff\\\"--\\n--\\nxyz", "r 1230 a\\t"));
  const auto both = import(kSocatBoth);
  EXPECT_THAT(told_lines(both), ElementsAre("w 0 a\\tb\\r\\nc\\\\d\\x00\\x01\\xff\\\"--\\n--\\nxyz",
                                            "r 1583 1234567890123456 "));
  EXPECT_THAT(both->problems, ElementsAre("line 7: no block of socat; left out"));
  EXPECT_THAT(test::header_line_of(both->paths), HasSubstr(R"("wall":"2026-11-23T21:53:12.662600Z")"));
  const auto text = import(kSocatText);
  EXPECT_THAT(told_lines(text), ElementsAre("w 0 a\\tb\\r\\nc\\\\d..\\n--\\nxyz12", "r 115 ok\\n"));
  EXPECT_THAT(text->guesses, ElementsAre(HasSubstr("UTC"), HasSubstr("2 dots")));
  EXPECT_THAT(text->problems, IsEmpty());
}

TEST_F(SocatFormatTest, IsToldByHowItBegins) {
  for (const char* const log : {kSocatHex, kSocatBoth, kSocatText})
    EXPECT_EQ(detect_format(log, ""), find_format("socat-x"));
  EXPECT_EQ(detect_format("> quoted\n", ""), nullptr);
}

TEST_F(SocatFormatTest, FractionsOfEveryVersion) {
  const auto at = [&](const std::string& fraction) {
    return told_lines(import("> 2024/02/29 23:59:59  length=1 from=0 to=0\n 61\n< 2024/03/01 00:00:00" +
                             fraction + "  length=1 from=0 to=0\n 62\n"))
        .back();
  };
  EXPECT_EQ(at(".000345678"), "r 1345678 b");
  EXPECT_EQ(at(".345678"), "r 1345678 b");
  EXPECT_EQ(at(".5678"), "r 1005678 b");
  EXPECT_EQ(at(".345678901"), "r 1345678 b");
  EXPECT_EQ(at(""), "r 1000000 b");
}

TEST_F(SocatFormatTest, OfEqualTimesWhatCameLaterStaysLater) {
  const std::string second = " 2024/02/29 23:59:59  length=1 from=0 to=0\n";
  const auto tape =
      import("<" + second + " 61\n>" + second + " 62\n<" + second + " 63\n>" + second + " 64\n");
  EXPECT_THAT(told_lines(tape), ElementsAre("r 0 a", "w 1 b", "r 1 c", "w 2 d"));
  EXPECT_THAT(tape->problems, IsEmpty());
  EXPECT_THAT(tape->guesses, Contains("its times are whole seconds"));
}

TEST_F(SocatFormatTest, ABlockThatIsBrokenOffIsAGap) {
  const auto tape = import(
      "> 2026/11/23 21:53:11  length=4 from=0 to=3\n 61 62\n"
      "< 2026/11/23 21:53:12  length=1 from=0 to=0\n 63\n"
      "< 2026/11/23 21:53:13  length=2 from=0 to=0\n");
  EXPECT_THAT(told_lines(tape),
              ElementsAre("w 0 ab", HasSubstr("\"gap\",\"bytes\":2"), "r 1000000 c", HasSubstr("\"gap\"")));
  EXPECT_THAT(tape->problems, ElementsAre("lines 3 and 5: a block ends early"));
  const auto none = import("hello\n");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, Errc::not_a_tape);
  EXPECT_THAT(none.error().message, HasSubstr("no block of socat"));
}

TEST_F(SocatFormatTest, ADayThatIsNoneIsNoBlock) {
  EXPECT_EQ(detect_format("> 2026/02/30 21:53:11  length=4 from=0 to=3\n 61\n", ""), nullptr);
  EXPECT_EQ(detect_format("> 2026/02/28 24:53:11  length=4 from=0 to=3\n 61\n", ""), nullptr);
}

class SocatRawFormatTest : public SocatFormatTest {};

TEST_F(SocatRawFormatTest, TheFilesTakeTurnsByLines) {
  test::write_file(dir / "reads", as_bytes("one\ntwo\n"));
  ImportOptions options;
  options.with = dir / "reads";
  const auto tape = import("1\n2\n3", options, "socat-rR");
  EXPECT_THAT(told_lines(tape), ElementsAre("w 0 1\\n", "r 1 one\\n", "w 2 2\\n", "r 3 two\\n", "w 4 3"));
  EXPECT_THAT(tape->guesses, ElementsAre(HasSubstr("took turns"), HasSubstr("all bytes came at once")));
}

TEST_F(SocatRawFormatTest, TheOtherFileIsFoundByItsName) {
  test::write_file(dir / "x.r", as_bytes("1\n"));
  test::write_file(dir / "x.R", as_bytes("one\n"));
  const auto import_file = [&](const std::string& name) {
    Result<Evidence> from = Evidence::open(name);
    ImportTape tape(new_tape(name + "tape"), {.sync = false}, {}, name);
    const auto end = find_format("socat-rR")->import_tape(*from, tape, {});
    return end ? tape.finish(*end) : Result<ImportedTape>(end.error());
  };
  EXPECT_THAT(told_lines(import_file(dir / "x.r")), ElementsAre("w 0 1\\n", "r 1 one\\n"));
  test::write_file(dir / "y.r", as_bytes("1\n"));
  const auto alone = import_file(dir / "y.r");
  EXPECT_THAT(told_lines(alone), ElementsAre("w 0 1\\n"));
  EXPECT_THAT(alone->guesses, Contains(HasSubstr("--with FILE")));
}

TEST_F(SocatRawFormatTest, AFileThatIsNotThereIsTold) {
  ImportOptions options;
  options.with = dir / "none";
  EXPECT_THAT(told_lines(import("1\n", options, "socat-rR")), ElementsAre(HasSubstr("cannot be read")));
}

}  // namespace
}  // namespace porttape
