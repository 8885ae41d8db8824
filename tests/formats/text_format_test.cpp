#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::exported;
using test::imported;
using test::lines_of;
using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;

const std::string kBegin = "porttape-text 1\n";

class TextFormatTest : public testing::Test {
 protected:
  TapePaths tape(const MemoryTape& records) {
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++made_))), records,
                            {.device = "serial:/dev/ttyUSB0", .driver = "pty:/tmp/laser"});
  }
  Result<ImportedTape> import(const std::string& text) {
    return imported(dir, "i" + std::to_string(++made_), "text", kBegin + text);
  }
  std::string error_of(const std::string& text) {
    const auto made = import(text);
    return made ? "" : made.error().message;
  }

  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(TextFormatTest, IsWhatItsDocumentSays) {
  const TapePaths paths = tape(MemoryTape()
                                   .open(0)
                                   .write(10'000, "AT\r\n")
                                   .read(22'345, std::string("\x01\x02\xff", 3))
                                   .event(30'000, event::Mark{"it \"fails\" here"})
                                   .close(1'000'000));
  const std::string text = exported(paths, "text");
  EXPECT_THAT(text, testing::StartsWith(kBegin));
  EXPECT_THAT(text, HasSubstr("+0.000000 open\n+0.010000 w \"AT\\r\\n\"\n+0.012345 r 01 02 ff  # ...\n"));
  EXPECT_THAT(text, HasSubstr("event {\"event\":\"mark\",\"text\":\"it \\\"fails\\\" here\"}\n"));
  EXPECT_THAT(text, HasSubstr("# 1 s\n+0.970000 close\n+0.000000 end\n"));
}

TEST_F(TextFormatTest, EveryByteAndLargeAndEmptyBlocks) {
  std::string all;
  for (int i = 0; i < 256; ++i) all += static_cast<char>(i);
  std::string large;
  for (int i = 0; i < 300'000; ++i) large += static_cast<char>(i % 251);
  const TapePaths paths =
      tape(MemoryTape().write(5, all).read(5, "").read(5, large).read(6, std::string(4000, 'x')));
  const auto made = imported(dir, "back", "text", exported(paths, "text"));
  EXPECT_EQ(lines_of(made), test::lines_on(paths));
}

TEST_F(TextFormatTest, ABlockMayHaveMoreThan64MiB) {
  const std::string line = " \"" + std::string(std::size_t{13} << 20U, 'x') + "\"\n";
  std::string text = "+0 r\n";
  for (int i = 0; i < 5; ++i) text += line;
  const auto made = import(text);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->blocks, 1U);
  EXPECT_EQ(std::filesystem::file_size(made->paths.read), 12 + (std::size_t{65} << 20U));
}

TEST_F(TextFormatTest, ATapeWithoutAnEndHasNoneAfterwards) {
  const auto made = import("+0 r 41\n");
  ASSERT_TRUE(made);
  EXPECT_THAT(exported(made->paths, "text"), testing::Not(HasSubstr(" end\n")));
}

TEST_F(TextFormatTest, WhatAPersonTypes) {
  const auto made = import(
      "\n# a comment\n"
      "0 open   # at once\n"
      "1.5\tw 0102 \"a\\x00b\" # bytes of both kinds\n"
      "  03 04\n"
      "\n"
      "+.5 r\n");
  EXPECT_THAT(lines_of(made).front(), HasSubstr("a time is expected"));
  EXPECT_THAT(
      lines_of(import("0 open\r\n1.5 w 0102 \"a\\x00b\"\r\n   03 04 # more\r\n+0.5 r\r\n+1 mark \"x\"\r\n"
                      "+0 event {\"event\":\"modem\",\"line\":\"dtr\",\"on\":true,\"by\":\"driver\"}\r\n")),
      ElementsAre(HasSubstr("open"), HasSubstr("1500000"), HasSubstr("2000000"), HasSubstr("\"x\""),
                  HasSubstr("\"dtr\"")));
}

TEST_F(TextFormatTest, ErrorsTellTheirPlace) {
  EXPECT_THAT(error_of("+0 r zz\n"), HasSubstr("evidence:2:6: bytes are expected"));
  EXPECT_THAT(error_of("+0 r \"a\\q\"\n"), HasSubstr("evidence:2:8: no such escape"));
  EXPECT_THAT(error_of("+0 r \"a\n"), HasSubstr("evidence:2:6: the text's closing quote"));
  EXPECT_THAT(error_of("0 open\n+0 oepn\n"), HasSubstr("evidence:3:4: 'oepn' is unknown; accepted: r, w"));
  EXPECT_THAT(error_of("5 open\n4 close\n"), HasSubstr("evidence:3:1: the time goes back"));
  EXPECT_THAT(error_of("soon open\n"), HasSubstr("evidence:2:1: a time is expected"));
  EXPECT_THAT(error_of("0.1234567 open\n"), HasSubstr("evidence:2:1: a time is expected"));
  EXPECT_THAT(error_of("99999999999 open\n"), HasSubstr("evidence:2:1: a time is expected"));
  EXPECT_THAT(error_of("4294967295 open\n+4294967295 close\n"), HasSubstr("evidence:3:1: the time is over"));
  EXPECT_THAT(error_of(" 41\n"), HasSubstr("evidence:2:2: bytes without a block"));
  EXPECT_THAT(error_of("0 end\n0 open\n"), HasSubstr("evidence:3:1: something behind the end"));
  EXPECT_THAT(error_of("0 open twice\n"), HasSubstr("evidence:2:8: something behind the line's end"));
  EXPECT_THAT(error_of("0 event {\n"), HasSubstr("evidence:2:9: "));
  EXPECT_THAT(error_of("header {}\n"), HasSubstr("evidence:2:8: "));
  EXPECT_THAT(error_of("0 open\nheader {}\n"), HasSubstr("evidence:3:1: the header stands before"));
  EXPECT_THAT(error_of("0 mark begin\n"), HasSubstr("evidence:2:8: a text in quotes"));
  const auto other = imported(dir, "other", "text", "something\n");
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().code, Errc::not_a_tape);
  EXPECT_TRUE(std::filesystem::is_empty(std::filesystem::path(dir / ".")));
}

}  // namespace
}  // namespace porttape
