#include "libport/formats/evidence.hpp"

#include <cstdio>
#include <string>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::vector<std::string> all_lines(Evidence& evidence) {
  std::vector<std::string> lines;
  for (;;) {
    const auto line = evidence.line();
    if (!line) lines.push_back("error: " + line.error().message);
    if (!line || !*line) return lines;
    lines.push_back(std::to_string((**line).number) + "@" + std::to_string((**line).offset) + ":" +
                    std::string((**line).text) + ((**line).whole ? "" : "…"));
  }
}

TEST(EvidenceTest, LinesOfEveryKindAndTheirPlaces) {
  Evidence evidence = Evidence::of("e", "one\r\n\ntwo\nlast");
  EXPECT_THAT(all_lines(evidence), ElementsAre("1@0:one", "2@5:", "3@6:two", "4@10:last…"));
  Evidence empty = Evidence::of("e", "");
  EXPECT_THAT(all_lines(empty), ElementsAre());
}

TEST(EvidenceTest, AFileIsReadAsItsBytesAre) {
  const test::TempDir dir;
  std::string text;
  for (int i = 0; i < 50'000; ++i) text += std::to_string(i) + (i % 7 == 0 ? "\r\n" : "\n");
  test::write_file(dir / "f", test::bytes_of(text));
  auto lines = Evidence::open(dir / "f");
  ASSERT_TRUE(lines);
  EXPECT_EQ(lines->size(), text.size());
  for (int i = 0; i < 50'000; ++i) {
    const auto line = lines->line();
    ASSERT_TRUE(line && *line);
    ASSERT_EQ((**line).text, std::to_string(i));
  }
  EXPECT_EQ(lines->offset(), text.size());
  auto bytes = Evidence::open(dir / "f");
  EXPECT_EQ(bytes->peek(3)->size(), 3U);
  EXPECT_EQ(*bytes->skip(100'000), 100'000U);
  Bytes rest(text.size());
  EXPECT_EQ(*bytes->read(rest), text.size() - 100'000);
  EXPECT_EQ(as_text(ByteView(rest).first(text.size() - 100'000)), std::string_view(text).substr(100'000));
  EXPECT_TRUE(bytes->peek()->empty());
}

TEST(EvidenceTest, ALineWithoutEndIsNoText) {
  Evidence evidence = Evidence::of("e", std::string(Evidence::kLongestLine + 1, 'x'));
  EXPECT_THAT(all_lines(evidence), ElementsAre(HasSubstr("error: e at byte 0: a line of more than 16 MiB")));
}

TEST(EvidenceTest, WhatCannotBeReadIsToldAndStays) {
  const test::TempDir dir;
  EXPECT_THAT(Evidence::open(dir / "none").error().message, HasSubstr("No such file"));
  EXPECT_THAT(Evidence::open(dir / ".").error().message, HasSubstr("is a folder"));
}

}  // namespace
}  // namespace porttape
