#include "libport/tape/event_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/json_text.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kFileHeader = "{\"format\":\"porttape-events\",\"version\":1}\n";

// Each event as "KIND TIME", last "error: …" or "torn".
std::vector<std::string> events_of(const std::string& text) {
  auto file = EventFile::create(test::memory("t.loge", test::bytes_of(text)));
  if (!file) return {"cannot open: " + file.error().message};
  std::vector<std::string> all;
  while (file->next() == EventFile::Step::event) {
    all.push_back(std::string(name_of(file->event().what)) + " " + std::to_string(to_us(file->event().at)));
  }
  if (file->next() == EventFile::Step::failed) all.push_back("error: " + file->error().message);
  if (file->torn_tail()) all.emplace_back("torn");
  return all;
}

TEST(EventFile, UnknownKindsAndKeysAreRead) {
  EXPECT_THAT(events_of(kFileHeader + "{\"new\":{\"deep\":[1,2]},\"t_us\":5,\"event\":\"hyperspace\"}\n"),
              ElementsAre("hyperspace 5"));
}

TEST(EventFile, EveryTruncationIsANote) {
  const std::string whole =
      kFileHeader + "{\"t_us\":1,\"event\":\"open\"}\n{\"t_us\":2,\"event\":\"close\"}\n";
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const auto all = events_of(whole.substr(0, size));
    for (const std::string& each : all) EXPECT_THAT(each, testing::Not(HasSubstr("error"))) << size;
    const bool at_line_end = size == 0 || whole[size - 1] == '\n';
    EXPECT_EQ(!all.empty() && all.back() == "torn", !at_line_end) << size;
  }
}

TEST(EventFile, DamageIsToldWithItsLine) {
  const auto second = [](const std::string& line) {
    return events_of(kFileHeader + line + "\n{\"t_us\":9,\"event\":\"x\"}\n");
  };
  EXPECT_THAT(second("nonsense"), ElementsAre("error: t.loge is damaged in line 2: not a JSON object"));
  EXPECT_THAT(second("[1]"), ElementsAre(HasSubstr("line 2: not a JSON object")));
  EXPECT_THAT(second(""), ElementsAre(HasSubstr("line 2: not a JSON object")));
  EXPECT_THAT(second("{}"), ElementsAre(HasSubstr("line 2: no t_us")));
  EXPECT_THAT(second("{\"t_us\":-1,\"event\":\"x\"}"), ElementsAre(HasSubstr("line 2: no t_us")));
  EXPECT_THAT(second("{\"t_us\":9223372036854775807,\"event\":\"x\"}"),
              ElementsAre(HasSubstr("line 2: t_us is later than any tape can be")));
  EXPECT_THAT(second("{\"t_us\":1.5,\"event\":\"x\"}"), ElementsAre(HasSubstr("line 2: no t_us")));
  EXPECT_THAT(second("{\"t_us\":99999999999999999999,\"event\":\"x\"}"),
              ElementsAre(HasSubstr("line 2: no t_us")));
  EXPECT_THAT(second("{\"t_us\":1}"), ElementsAre(HasSubstr("line 2: no event")));
  EXPECT_THAT(second("{\"t_us\":10,\"event\":\"x\"}"),
              ElementsAre("x 10", "error: t.loge is damaged in line 3: time goes back from 10 to 9 us"));
  EXPECT_THAT(second(std::string(EventFile::kMaxLine + 1, 'x')),
              ElementsAre(HasSubstr("line 2: longer than 65536")));
  EXPECT_THAT(second(std::string(1000, '[')), ElementsAre(HasSubstr("line 2: not a JSON object")));
}

TEST(EventFile, BytesThatAreNotUtf8DoNotBreakIt) {
  EXPECT_THAT(events_of(kFileHeader + "{\"t_us\":5,\"event\":\"mark\",\"text\":\"\xff\xc3\"}\n"),
              ElementsAre("mark 5"));
}

TEST(EventFile, OtherFilesAreNotEventsFiles) {
  EXPECT_THAT(events_of("hello\n"), ElementsAre(HasSubstr("no porttape-events header")));
  EXPECT_THAT(events_of("{\"format\":\"other\"}\n"), ElementsAre(HasSubstr("no porttape-events header")));
  EXPECT_THAT(events_of("{\"format\":\"porttape-events\",\"version\":2}\n"),
              ElementsAre(HasSubstr("version 2")));
  EXPECT_THAT(events_of(std::string(100'000, 'x')), ElementsAre(HasSubstr("its first line has no end")));
}

TEST(EventFile, LinesCrossTheBufferUnharmed) {
  std::string text = kFileHeader;
  std::vector<std::string> expected;
  for (int i = 0; i < 20'000; ++i) {
    text += "{\"t_us\":" + std::to_string(i) + ",\"event\":\"tick\"}\n";
    expected.push_back("tick " + std::to_string(i));
  }
  EXPECT_EQ(events_of(text), expected);
}

TEST(EventFile, WhatIsWrittenIsReadBack) {
  const std::string open = encode(tape_time_us(1), event::Open{});
  const std::string mark = encode(tape_time_us(8), event::Mark{std::string("a\0b\x1b", 4)});
  auto file = EventFile::create(test::memory(
      "t.loge",
      test::bytes_of(encode(TapeHeader{"dev\"ice", "driver", "2024", "host", "tool"}) + open + mark)));
  ASSERT_TRUE(file);
  EXPECT_EQ(*file->header(), (TapeHeader{"dev\"ice", "driver", "2024", "host", "tool"}));
  for (int i = 0; i < 2; ++i) {
    ASSERT_EQ(file->next(), EventFile::Step::event);
    EXPECT_EQ(file->event().at, tape_time_us(1));
    EXPECT_EQ(file->event().what, Event(event::Open{}));
    EXPECT_EQ(std::string(file->line()) + '\n', open);
    ASSERT_EQ(file->next(), EventFile::Step::event);
    EXPECT_EQ(file->event().what, Event(event::Mark{std::string("a\0b\x1b", 4)}));
    EXPECT_EQ(std::string(file->line()) + '\n', mark);
    EXPECT_EQ(file->next(), EventFile::Step::end);
    file->rewind();
  }
}

// What the rest of it is, from one call of next() on.
std::vector<std::string> rest_of(EventFile& file) {
  std::vector<std::string> all;
  EventFile::Step step{};
  while ((step = file.next()) == EventFile::Step::event) all.emplace_back(file.line());
  all.push_back(step == EventFile::Step::failed ? file.error().message : "end");
  return all;
}

TEST(EventFile, BeginsAgainFromAnywhere) {
  const std::string header = encode(TapeHeader{.device = "d", .driver = "p", .id = "0123"});
  const std::string open = encode(tape_time_us(1), event::Open{});
  StreamDigest lines;
  lines.add(as_bytes(header));
  lines.add(as_bytes(open));
  const std::string end = encode(tape_time_us(2), event::End{{}, {}, lines.value()});
  for (const std::string& last :
       {std::string(), std::string("{\"t_us\":3,\"ev"), std::string("nonsense\n")}) {
    auto file = EventFile::create(test::memory("t.loge", test::bytes_of(header + open + end + last)));
    ASSERT_TRUE(file);
    const std::vector<std::string> all = rest_of(*file);
    ASSERT_EQ(all.size(), 3U) << all.back();
    EXPECT_EQ(all[0] + all[1] + "\n", open.substr(0, open.size() - 1) + end);
    for (int steps = 0; steps < 5; ++steps) {
      file->rewind();
      EXPECT_EQ(file->line(), "");
      EXPECT_EQ(file->torn_tail(), std::nullopt);
      for (int n = 0; n < steps; ++n) (void)file->next();
      file->rewind();
      EXPECT_EQ(rest_of(*file), all) << steps;
    }
  }
}

TEST(EventFile, AZeroEventReplacesTheHeadersZero) {
  auto file = EventFile::create(test::memory(
      "t.loge",
      test::bytes_of(kFileHeader + R"({"t_us":0,"event":"zero","wall":"2024","monotonic_us":7,"boot":"b"})"
                                   "\n")));
  ASSERT_TRUE(file);
  EXPECT_FALSE(file->header()->zero);
  ASSERT_EQ(file->next(), EventFile::Step::event);
  EXPECT_EQ(file->header()->zero, (TapeZero{"2024", 7, "b"}));
  file->rewind();
  EXPECT_FALSE(file->header()->zero);
}

TEST(JsonText, IsAlwaysWellFormed) {
  EXPECT_EQ(json_quote("a\"\\\n\r\t\x01\x7f"), "\"a\\\"\\\\\\n\\r\\t\\u0001\\u007f\"");
  EXPECT_EQ(to_utf8("\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80"), "\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80");
  const std::string bad = "\xEF\xBF\xBD";
  EXPECT_EQ(to_utf8("\xff"), bad);
  EXPECT_EQ(to_utf8("\xc0\xaf"), bad + bad);                      // overlong
  EXPECT_EQ(to_utf8("\xed\xa0\x80"), bad + bad + bad);            // surrogate
  EXPECT_EQ(to_utf8("\xf4\x90\x80\x80"), bad + bad + bad + bad);  // beyond U+10FFFF
  EXPECT_EQ(to_utf8("x\xe2\x82"), "x" + bad + bad);               // cut
}

}  // namespace
}  // namespace porttape
