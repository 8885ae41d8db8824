#include "tools/tape_parts.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

// A tape's records as text: `0 open, 10 w ab, …`.
std::string text_of(const TapePaths& tape) {
  Result<TapeReader> reader = TapeReader::open(tape);
  std::string text;
  for (;;) {
    const auto next = reader->next();
    EXPECT_TRUE(next.has_value());
    if (!next || !*next) return text;
    const Record& record = **next;
    text += std::to_string(to_us(record.at)) + ' ';
    if (record.event != nullptr) {
      text += std::string(name_of(*record.event)) + ", ";
    } else {
      text += (record.kind == RecordKind::read ? "r " : "w ") + std::string(as_text(record.data)) + ", ";
    }
  }
}

class TapePartsTest : public testing::Test {
 protected:
  std::string cut(const std::string& tape, const std::vector<std::size_t>& kept) {
    const Result<TapeParts> parts = TapeParts::load(literal_tape(tape));
    EXPECT_TRUE(parts.has_value());
    if (!parts) return {};
    count = parts->parts().size();
    const TapePaths paths = literal_tape(dir / ("cut" + std::to_string(++cuts) + ".log"));
    const Result<void> written = parts->write(paths, kept, false);
    EXPECT_TRUE(written.has_value());
    made = paths;
    return text_of(paths);
  }
  TempDir dir;
  TapePaths made;
  std::size_t count = 0;
  int cuts = 0;
};

TEST_F(TapePartsTest, ExchangesAreLeftOutWholeAndTheirTimeWithThem) {
  const std::string tape = make_tape(dir, "t", {{20, "1"}, {40, "2"}, {45, "2"}, {60, "3"}},
                                     {{10, "a"}, {30, "b"}, {31, "b"}, {50, "c"}});
  EXPECT_EQ(cut(tape, {0, 2}), "10 w a, 20 r 1, 25 w c, 35 r 3, 36 end, ");
  EXPECT_EQ(count, 3U);
  EXPECT_EQ(cut(tape, {1}), "10 w b, 11 w b, 20 r 2, 25 r 2, 26 end, ");
}

TEST_F(TapePartsTest, EventsOfTheLineStayAndTheirUnknownKeysToo) {
  const std::string tape =
      make_tape(dir, "t", {{20, "1"}, {40, "2"}, {60, "3"}}, {{10, "a"}, {30, "b"}, {50, "c"}},
                R"({"t_us":0,"event":"open","new":7})"
                "\n"
                R"({"t_us":22,"event":"mark","text":"here"})"
                "\n"
                R"({"t_us":25,"event":"close"})"
                "\n"
                R"({"t_us":26,"event":"open"})"
                "\n"
                R"({"t_us":45,"event":"close"})"
                "\n"
                R"({"t_us":46,"event":"open"})"
                "\n"
                R"({"t_us":70,"event":"close"})"
                "\n"
                R"({"t_us":70,"event":"end"})"
                "\n");
  EXPECT_EQ(cut(tape, {0, 2}),
            "0 open, 10 w a, 20 r 1, 22 mark, 25 close, 26 open, 30 w c, 40 r 3, 50 close, 50 end, ")
      << "without the session in which nothing is left";
  const Bytes events = read_file(made.events);
  EXPECT_NE(as_text(events).find(R"("new":7)"), std::string::npos);
}

TEST_F(TapePartsTest, WhatIsReadBeforeAFirstWriteIsAPartABlock) {
  const std::string tape = make_tape(dir, "t", {{5, "x"}, {6, "y"}, {20, "1"}}, {{10, "a"}});
  EXPECT_EQ(cut(tape, {1, 2}), "1 r y, 5 w a, 15 r 1, 16 end, ");
  EXPECT_EQ(count, 3U);
}

TEST_F(TapePartsTest, NoTapeIsReplaced) {
  const std::string tape = make_tape(dir, "t", {{20, "1"}}, {{10, "a"}});
  const Result<TapeParts> parts = TapeParts::load(literal_tape(tape));
  ASSERT_TRUE(parts.has_value());
  const Result<void> written = parts->write(literal_tape(tape), {0}, false);
  ASSERT_FALSE(written.has_value());
  EXPECT_EQ(written.error().code, Errc::usage);
}

}  // namespace
}  // namespace porttape::test
