#include "libport/tape/event_salvage.hpp"

#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event_file.hpp"
#include "tests/support/holed_source.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kFirstLine = "{\"format\":\"porttape-events\",\"version\":1}\n";

std::string mark_at(std::int64_t us) { return "{\"t_us\":" + std::to_string(us) + ",\"event\":\"mark\"}\n"; }

// "2: 10" for a line and its time, "lost 2+3: why" for three lines from line 2 on; last the header's line
// where it is there.
std::vector<std::string> lines_salvaged(const std::string& text, std::size_t behind = 0) {
  MemorySource source("e", test::bytes_of(text));
  EventSalvage salvage(source, text.size() - behind);
  std::vector<std::string> all;
  for (;;) {
    const auto step = salvage.next();
    if (!step) return {"error: " + step.error().message};
    if (step->lost)
      all.push_back("lost " + std::to_string(step->lost->line) + "+" + std::to_string(step->lost->lines) +
                    ": " + step->lost->why);
    if (step->line)
      all.push_back(std::to_string(step->line->number) + ": " + std::to_string(to_us(step->line->event.at)));
    if (!step->lost && !step->line) break;
  }
  if (!salvage.header_line().empty()) all.push_back("header");
  return all;
}

std::vector<std::string> of_times(std::initializer_list<std::int64_t> times) {
  std::string text = kFirstLine;
  for (const std::int64_t us : times) text += mark_at(us);
  std::vector<std::string> all = lines_salvaged(text);
  EXPECT_EQ(all.back(), "header");
  all.pop_back();
  return all;
}

std::string misplaced(int line, std::int64_t us) {
  return "lost " + std::to_string(line) + "+1: its time, " + std::to_string(us) + " us, is out of order";
}

TEST(EventSalvage, GivesTheLinesOfASoundFile) {
  EXPECT_THAT(lines_salvaged(kFirstLine + mark_at(5) + mark_at(5) + mark_at(7)),
              ElementsAre("2: 5", "3: 5", "4: 7", "header"));
  EXPECT_THAT(lines_salvaged(kFirstLine), ElementsAre("header"));
  EXPECT_THAT(lines_salvaged(""), IsEmpty());
}

TEST(EventSalvage, GivesALineWholeAndWithItsEvent) {
  MemorySource source("e",
                      test::bytes_of(kFirstLine + R"({"t_us":5,"event":"mark","text":"x","new":1})" + "\n"));
  EventSalvage salvage(source, *source.size());
  const auto step = salvage.next();
  ASSERT_TRUE(step && step->line);
  EXPECT_EQ(step->line->text, R"({"t_us":5,"event":"mark","text":"x","new":1})");
  EXPECT_EQ(step->line->event.what, Event(event::Mark{"x"}));
  EXPECT_EQ(salvage.header_line() + "\n", kFirstLine);
}

TEST(EventSalvage, ALineThatFitsNeitherItsNeighboursIsTheOneThatIsLost) {
  EXPECT_THAT(of_times({10, 30, 20, 25}), ElementsAre("2: 10", misplaced(3, 30), "4: 20", "5: 25"));
  EXPECT_THAT(of_times({10, 30, 20, 35}), ElementsAre("2: 10", "3: 30", misplaced(4, 20), "5: 35"));
  EXPECT_THAT(of_times({10, 30, 20, 30}), ElementsAre("2: 10", "3: 30", misplaced(4, 20), "5: 30"));
  EXPECT_THAT(of_times({10, 30, 5}), ElementsAre("2: 10", "3: 30", misplaced(4, 5)));
  EXPECT_THAT(of_times({10, 30, 9, 9}),
              ElementsAre("2: 10", "3: 30", "lost 4+2: its time, 9 us, is out of order"));
  EXPECT_THAT(of_times({10, 30, 10}), ElementsAre("2: 10", misplaced(3, 30), "4: 10"));
  EXPECT_THAT(of_times({30, 10}), ElementsAre(misplaced(2, 30), "3: 10"));
  EXPECT_THAT(of_times({30, 10, 20}), ElementsAre(misplaced(2, 30), "3: 10", "4: 20"));
  EXPECT_THAT(of_times({30, 10, 40}), ElementsAre("2: 30", misplaced(3, 10), "4: 40"));
}

TEST(EventSalvage, WhatIsLostStandsInFrontOfTheLineBehindIt) {
  const std::string good = mark_at(3) + mark_at(4) + mark_at(5);
  EXPECT_THAT(lines_salvaged(kFirstLine + mark_at(1) + mark_at(2) + "x\n" + "y\n" + good + "{}\n"),
              ElementsAre("2: 1", "3: 2", "lost 4+2: not a JSON object", "6: 3", "7: 4", "8: 5",
                          "lost 9+1: no t_us, or it is not a number of microseconds", "header"));
}

TEST(EventSalvage, AFirstLineThatIsNoHeaderIsLost) {
  EXPECT_THAT(lines_salvaged("x\n" + mark_at(1)), ElementsAre("lost 1+1: it is no header", "2: 1"));
  EXPECT_THAT(lines_salvaged(mark_at(1) + kFirstLine + mark_at(2)),
              ElementsAre("1: 1", HasSubstr("lost 2+1: no t_us"), "3: 2"));
}

TEST(EventSalvage, AnUnfinishedLastLineIsLost) {
  EXPECT_THAT(lines_salvaged(kFirstLine + mark_at(1) + mark_at(2).substr(0, 20)),
              ElementsAre("2: 1", "lost 3+1: an unfinished line", "header"));
  EXPECT_THAT(lines_salvaged(kFirstLine + "x"), ElementsAre("lost 2+1: an unfinished line", "header"));
  EXPECT_THAT(lines_salvaged(kFirstLine.substr(0, 10)), ElementsAre("lost 1+1: it is no header"));
}

TEST(EventSalvage, ALineOfMoreThan64KiBIsLost) {
  const auto line_of = [](std::size_t size) {
    const std::string begin = R"({"t_us":5,"event":"mark","text":")";
    return begin + std::string(size - begin.size() - 2, 'x') + "\"}\n";
  };
  EXPECT_THAT(lines_salvaged(kFirstLine + line_of(65'535) + mark_at(6)),
              ElementsAre("2: 5", "3: 6", "header"));
  for (const std::size_t size : {65'536U, 65'537U, 131'072U, 200'000U})
    EXPECT_THAT(lines_salvaged(kFirstLine + line_of(size) + mark_at(6)),
                ElementsAre("lost 2+1: longer than 65536 bytes", "3: 6", "header"))
        << size;
}

TEST(EventSalvage, AHoleIsOneLineThatIsLost) {
  constexpr std::uint64_t kHuge = std::uint64_t{1} << 40U;
  const std::string end = mark_at(20);
  test::HoledSource::Read read;
  test::HoledSource source(
      read, kHuge,
      {{0, test::bytes_of(kFirstLine + mark_at(10))}, {kHuge - end.size(), test::bytes_of(end)}});
  EventSalvage salvage(source, kHuge);
  const auto first = salvage.next();
  ASSERT_TRUE(first && first->line);
  EXPECT_EQ(to_us(first->line->event.at), 10);
  const auto second = salvage.next();
  ASSERT_TRUE(second && second->lost && second->line);
  EXPECT_EQ(second->lost->why, "a hole in the file");
  EXPECT_EQ(to_us(second->line->event.at), 20);
  EXPECT_LT(read.bytes, std::uint64_t{4} << 20U);
}

TEST(EventSalvage, WhatComesMeanwhileIsNotRead) {
  EXPECT_THAT(lines_salvaged(kFirstLine + mark_at(1) + mark_at(2), mark_at(2).size()),
              ElementsAre("2: 1", "header"));
}

class BrokenSource final : public ByteSource {
 public:
  Result<std::size_t> read_at(std::uint64_t, std::span<Byte>) override {
    return make_error(Errc::io, "out of order");
  }
  Result<std::uint64_t> size() override { return make_error(Errc::io, "no size"); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::string name_ = "b";
};

TEST(EventSalvage, AFailedReadIsItsError) {
  BrokenSource source;
  EventSalvage salvage(source, 100);
  EXPECT_EQ(salvage.next().error().message, "out of order");
}

// A file to which a test adds, and whose next read may fail.
struct Appended {
  Bytes bytes;
  bool fails = false;
};
class AppendedLines final : public ByteSource {
 public:
  explicit AppendedLines(Appended& file) : file_(file) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    if (file_.fails) return make_error(Errc::io, "out of order");
    return MemorySource("e", file_.bytes).read_at(offset, into);
  }
  Result<std::uint64_t> size() override { return file_.bytes.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  Appended& file_;
  std::string name_ = "e";
};

class GrowingEventFile : public testing::Test {
 protected:
  EventFile open() {
    auto file = EventFile::create(std::make_unique<AppendedLines>(appended));
    if (!file) throw std::runtime_error(file.error().message);
    return std::move(*file);
  }
  void add(const std::string& text) { test::append(appended.bytes, text); }
  // Times of the events up to the end.
  static std::vector<std::int64_t> times(EventFile& file) {
    std::vector<std::int64_t> all;
    while (file.next() == EventFile::Step::event) all.push_back(to_us(file.event().at));
    EXPECT_EQ(file.next(), EventFile::Step::end);
    return all;
  }

  Appended appended;
};

TEST_F(GrowingEventFile, GoesOnBehindItsEndWithTheUnfinishedLine) {
  add(kFirstLine + mark_at(1) + mark_at(2).substr(0, 5));
  EventFile file = open();
  EXPECT_THAT(times(file), ElementsAre(1));
  EXPECT_EQ(file.torn_tail(), "e: the last line (3) is unfinished and does not count");
  EXPECT_THAT(times(file), IsEmpty()) << "until it is told to go on";
  file.read_on();
  EXPECT_EQ(file.torn_tail(), std::nullopt);
  EXPECT_THAT(times(file), IsEmpty());
  add(mark_at(2).substr(5) + mark_at(2));
  file.read_on();
  EXPECT_THAT(times(file), ElementsAre(2, 2));
  EXPECT_EQ(file.torn_tail(), std::nullopt);
  EXPECT_EQ(std::string(file.line()) + "\n", mark_at(2));
}

TEST_F(GrowingEventFile, MayGetItsHeaderLater) {
  EventFile file = open();
  EXPECT_EQ(file.next(), EventFile::Step::end);
  EXPECT_EQ(file.header(), std::nullopt);
  EXPECT_EQ(file.header_line(), "");
  add(kFirstLine.substr(0, 5));
  file.read_on();
  EXPECT_EQ(file.next(), EventFile::Step::end);
  add(kFirstLine.substr(5) + mark_at(1));
  file.read_on();
  EXPECT_THAT(times(file), ElementsAre(1));
  EXPECT_TRUE(file.header());
  EXPECT_EQ(file.header_line() + "\n", kFirstLine);
}

TEST_F(GrowingEventFile, AHeaderThatIsNoneIsDamageWheneverItComes) {
  EventFile file = open();
  add("x\n");
  file.read_on();
  EXPECT_EQ(file.next(), EventFile::Step::failed);
  EXPECT_EQ(file.error(), make_error(Errc::damaged_tape,
                                     "e is not an events file: its first line is no "
                                     "porttape-events header"));
  file.read_on();
  EXPECT_EQ(file.next(), EventFile::Step::failed) << "an error stays";
  appended.bytes.clear();
  add(kFirstLine);
  file.rewind();
  EXPECT_EQ(file.next(), EventFile::Step::end);
  appended.bytes.clear();
  add("x\n");
  file.rewind();
  EXPECT_EQ(file.next(), EventFile::Step::failed);
}

TEST_F(GrowingEventFile, IsReadOnOnlyFromItsEnd) {
  add(kFirstLine + mark_at(1) + mark_at(2) + mark_at(3));
  EventFile file = open();
  EXPECT_EQ(file.next(), EventFile::Step::event);
  file.read_on();
  EXPECT_THAT(times(file), ElementsAre(2, 3));
}

TEST_F(GrowingEventFile, AfterDamageItBeginsAgainByRewind) {
  add(kFirstLine + mark_at(5) + mark_at(4));
  EventFile file = open();
  for (int round = 0; round < 2; ++round) {
    EXPECT_EQ(file.next(), EventFile::Step::event);
    EXPECT_EQ(to_us(file.event().at), 5);
    EXPECT_EQ(file.next(), EventFile::Step::failed);
    EXPECT_EQ(file.error(),
              make_error(Errc::damaged_tape, "e is damaged in line 3: time goes back from 5 to 4 us"));
    file.rewind();
  }
}

TEST_F(GrowingEventFile, AFailedReadIsItsErrorAndNoDamage) {
  appended.fails = true;
  EXPECT_EQ(EventFile::create(std::make_unique<AppendedLines>(appended)).error(),
            make_error(Errc::io, "out of order"));
  appended.fails = false;
  add(kFirstLine);
  EventFile file = open();
  appended.fails = true;
  EXPECT_EQ(file.next(), EventFile::Step::failed);
  EXPECT_EQ(file.error().code, Errc::io);
}

TEST_F(GrowingEventFile, ALineHasUpTo65535Bytes) {
  const std::string begin = R"({"t_us":5,"event":"mark","text":")";
  for (const std::size_t size : {65'535U, 65'536U}) {
    appended.bytes.clear();
    add(kFirstLine + begin + std::string(size - begin.size() - 2, 'x') + "\"}\n");
    EventFile file = open();
    EXPECT_EQ(file.next(), size == 65'535 ? EventFile::Step::event : EventFile::Step::failed);
    if (size == 65'535) continue;
    EXPECT_EQ(file.error().message, "e is damaged in line 2: longer than 65536 bytes");
  }
}

}  // namespace
}  // namespace porttape
