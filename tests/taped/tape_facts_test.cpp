#include "libport/taped/tape_facts.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/memory_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::MemoryTape;
using testing::ElementsAre;
using testing::IsEmpty;

MemoryTape sessions() {
  return MemoryTape()
      .open(100)
      .write(150, "w")
      .read(200, "one")
      .hang_up(300)
      .close(400)
      .open(1000)
      .write(1100, "two")
      .gap(1300, 5, 900)
      .hang_up(1350)
      .close(1400)
      .open(2000)
      .close(2100);
}

class TapeFactsTest : public testing::Test {
 protected:
  TapePaths tape(const MemoryTape& records, const TapeHeader& header = {}) {
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++count))), records, header);
  }
  static TapeFacts facts(const TapePaths& paths, const PlayedPart& played = {}) {
    const Result<TapeFacts> found = tape_facts(paths, played);
    EXPECT_TRUE(found) << found.error().message;
    return found ? *found : TapeFacts{};
  }
  static std::vector<std::int64_t> hang_ups(const TapeFacts& facts) {
    std::vector<std::int64_t> all;
    for (const TapeTime at : facts.facts.hang_ups) all.push_back(to_us(at));
    return all;
  }
  static std::vector<std::pair<std::int64_t, std::int64_t>> gaps(const TapeFacts& facts) {
    std::vector<std::pair<std::int64_t, std::int64_t>> all;
    for (const TapeGap& gap : facts.facts.gaps) all.emplace_back(to_us(gap.from), to_us(gap.to));
    return all;
  }

  test::TempDir dir;
  int count = 0;
};

TEST_F(TapeFactsTest, OfAWholeTapeAreOfAllItsSessions) {
  const TapeFacts all = facts(tape(
      sessions(), {.device = {}, .driver = {}, .zero = TapeZero{"2024-05-06T07:08:09.000000Z", 5, "boot"}}));
  EXPECT_EQ(all.facts.opens, 3U);
  EXPECT_THAT(hang_ups(all), ElementsAre(300, 1350));
  EXPECT_THAT(gaps(all), ElementsAre(std::pair(900, 1300)));
  EXPECT_EQ(all.facts.gaps[0].bytes, 5U);
  EXPECT_EQ(all.facts.gaps[0].why, "disk full");
  ASSERT_TRUE(all.facts.totals.has_value());
  EXPECT_EQ(all.facts.totals->reads, 3U);
  EXPECT_EQ(all.facts.totals->writes, 4U);
  EXPECT_TRUE(all.part.whole());
  EXPECT_EQ(to_us(all.last), 2100);
  EXPECT_EQ(all.ended, true);
  EXPECT_FALSE(all.flaw.has_value());
  ASSERT_TRUE(all.zero.has_value());
  EXPECT_EQ(all.zero->boot, "boot");
}

TEST_F(TapeFactsTest, OfASessionAreCountedFromItsOpen) {
  const TapeFacts second = facts(tape(sessions()), {.session = 2});
  EXPECT_EQ(second.facts.opens, 1U);
  EXPECT_THAT(hang_ups(second), ElementsAre(350));
  EXPECT_THAT(gaps(second), ElementsAre(std::pair(0, 300))) << "it began before the session";
  EXPECT_FALSE(second.facts.totals.has_value());
  EXPECT_EQ(second.facts.preroll_from, TapeTime{});
  EXPECT_EQ(to_us(second.part.from), 1000);
  EXPECT_EQ(to_us(second.part.to), 1400);
  EXPECT_EQ(to_us(second.last), 400);
}

TEST_F(TapeFactsTest, WhetherItHasItsEndIsKnownOfTheLastSessionAlone) {
  const TapePaths paths = tape(sessions());
  EXPECT_EQ(facts(paths, {.session = 1}).ended, std::nullopt);
  EXPECT_EQ(facts(paths, {.session = 2}).ended, std::nullopt);
  EXPECT_EQ(facts(paths, {.session = 3}).ended, true);
  EXPECT_EQ(facts(paths, {.end = tape_time_us(2050)}).ended, std::nullopt);
}

TEST_F(TapeFactsTest, ASessionThatIsNotThereIsNamedWithHowManyThereAre) {
  const TapePaths three = tape(sessions());
  const auto fourth = tape_facts(three, {.session = 4});
  ASSERT_FALSE(fourth);
  EXPECT_EQ(fourth.error().code, Errc::usage);
  EXPECT_EQ(fourth.error().message, "option 'session': tape '" + three.name() +
                                        "' has 3 sessions, and no number 4; `porttape info` lists them");
  for (const MemoryTape& one : {MemoryTape().read(1, "a"), MemoryTape().open(0).close(1)}) {
    const auto second = tape_facts(tape(one), {.session = 2});
    ASSERT_FALSE(second);
    EXPECT_THAT(second.error().message, testing::HasSubstr("has 1 session, and no number 2;"));
  }
}

TEST_F(TapeFactsTest, ATapeWithoutOpensIsOneSession) {
  for (const std::uint64_t session : {0U, 1U}) {
    const TapeFacts all = facts(tape(MemoryTape().read(5, "abc")), {.session = session});
    EXPECT_EQ(all.facts.opens, 0U);
    EXPECT_EQ(all.facts.preroll_from, TapeTime{});
    EXPECT_EQ(all.ended, true);
    EXPECT_TRUE(all.facts.totals.has_value());
    EXPECT_TRUE(all.part.whole());
  }
}

TEST_F(TapeFactsTest, AnEndLeavesOutTheOpensBehindItAndTheTotals) {
  const TapePaths paths = tape(sessions());
  for (const auto& [end, opens] : {std::pair(100, 0U), {101, 1U}, {2000, 2U}, {2001, 3U}}) {
    const TapeFacts part = facts(paths, {.end = tape_time_us(end)});
    EXPECT_EQ(part.facts.opens, opens) << end;
    EXPECT_EQ(to_us(part.part.until), end);
    EXPECT_FALSE(part.facts.totals.has_value());
  }
}

TEST_F(TapeFactsTest, AStartIsPrerolledFromTheOpenOfItsSession) {
  const TapePaths paths = tape(sessions());
  const std::vector<std::pair<int, std::optional<int>>> known = {
      {99, {}}, {100, 100}, {399, 100}, {400, {}}, {999, {}}, {1000, 1000}, {2050, 2000}, {2100, {}}};
  for (const auto& [start, open] : known) {
    const TapeFacts part = facts(paths, {.start = tape_time_us(start)});
    const std::optional<TapeTime> begun = open ? std::optional(tape_time_us(*open)) : std::nullopt;
    EXPECT_EQ(part.facts.preroll_from, begun) << start;
    EXPECT_FALSE(part.facts.totals.has_value()) << start;
    EXPECT_EQ(part.facts.opens, 3U) << start;
  }
}

TEST_F(TapeFactsTest, AFileThatIsNotAsLongAsTheEndTellsIsAFlaw) {
  const TapePaths paths = tape(sessions());
  const auto size_of_write = fs::file_size(paths.write);
  const auto size_of_read = fs::file_size(paths.read);
  const auto flaw_of = [&](const std::string& path, std::uintmax_t recorded, int blocks,
                           const std::string& found) {
    return path + " " + found + ", and by its tape's end it has " + std::to_string(recorded) + " (" +
           std::to_string(blocks) + " blocks); `porttape verify` says more";
  };
  for (const int more : {-1, 1}) {
    fs::resize_file(paths.write, size_of_write + static_cast<std::uintmax_t>(more));
    const TapeFacts known = facts(paths);
    ASSERT_TRUE(known.flaw.has_value());
    EXPECT_EQ(known.flaw->code, Errc::damaged_tape);
    EXPECT_EQ(known.flaw->message,
              flaw_of(paths.write, size_of_write, 2,
                      "has " + std::to_string(size_of_write + static_cast<std::uintmax_t>(more)) + " bytes"));
  }
  fs::remove(paths.read);
  const TapeFacts both = facts(paths);
  ASSERT_TRUE(both.flaw.has_value());
  EXPECT_EQ(both.flaw->message, flaw_of(paths.read, size_of_read, 1, "is missing"));
}

TEST_F(TapeFactsTest, AFileOfNoBlocksMayBeMissing) {
  const TapePaths paths = tape(MemoryTape().read(1, "a"));
  fs::remove(paths.write);
  EXPECT_FALSE(facts(paths).flaw.has_value());
}

TEST_F(TapeFactsTest, WithoutItsEndATapeHasNoTotalsAndNoFlaw) {
  const TapePaths paths = literal_tape(dir / "open");
  auto made = NewTape::create(paths, TapeHeader{}, {.sync = false});
  ASSERT_TRUE(made);
  ASSERT_TRUE(made->event(tape_time_us(1), event::Open{}));
  ASSERT_TRUE(made->block(Direction::read, tape_time_us(2), as_bytes("abc")));
  ASSERT_TRUE(made->finish(std::nullopt));
  fs::remove(paths.read);
  const TapeFacts known = facts(paths);
  EXPECT_EQ(known.ended, false);
  EXPECT_FALSE(known.facts.totals.has_value());
  EXPECT_FALSE(known.flaw.has_value());
  EXPECT_EQ(known.facts.opens, 1U);
  EXPECT_EQ(to_us(known.last), 1);
}

TEST_F(TapeFactsTest, WithoutEventsNothingIsKnown) {
  const TapePaths paths = tape(sessions());
  fs::remove(paths.events);
  const TapeFacts known = facts(paths);
  EXPECT_EQ(known.ended, std::nullopt);
  EXPECT_EQ(known.facts.opens, 0U);
  EXPECT_THAT(hang_ups(known), IsEmpty());
  EXPECT_FALSE(known.zero.has_value());
  EXPECT_FALSE(known.facts.totals.has_value());
}

TEST_F(TapeFactsTest, EventsThatCannotBeReadAreAnError) {
  const TapePaths paths = tape(sessions());
  test::write_file(paths.events, as_bytes("no events\nat all\n"));
  EXPECT_FALSE(tape_facts(paths, {}));
}

TEST_F(TapeFactsTest, TheLineIsAsItWasBeforeTheSession) {
  const TapePaths paths = tape(MemoryTape()
                                   .open(0)
                                   .event(1, event::Settings{Side::device, SeenSettings{.baud = 300}, {}})
                                   .close(2)
                                   .open(10)
                                   .event(11, event::Settings{Side::device, SeenSettings{.baud = 1200}, {}})
                                   .close(12));
  EXPECT_EQ(facts(paths, {.session = 2}).facts.line.baud, 300U);
  EXPECT_EQ(facts(paths, {.session = 2}).line.own()->baud, 1200U);
}

TEST_F(TapeFactsTest, OnlyAnEndWithDigestsCanBeChecked) {
  const MemoryTape records = MemoryTape().open(0).write(1, "ask").read(2, "answer").close(3);
  const TapePaths with = tape(records, {.device = "d", .driver = "p", .id = "0123"});
  EXPECT_TRUE(facts(with).checkable);
  const std::string events(as_text(test::read_file(with.events)));
  test::write_file(with.events, as_bytes(events.substr(0, events.find('\n') + 1)));
  EXPECT_FALSE(facts(with).checkable) << "it has no end";
  fs::remove(with.events);
  EXPECT_FALSE(facts(with).checkable);
}

// Whether all of a tape was read, and the error that was found.
std::pair<bool, std::optional<Errc>> checked(const TapePaths& paths) {
  const std::optional<TapeCheck> check = check_tape(paths);
  EXPECT_TRUE(check);
  if (!check) return {};
  return {check->whole, check->found ? std::nullopt : std::optional(check->found.error().code)};
}

TEST_F(TapeFactsTest, ATapeIsCheckedAsFarAsItCanBeRead) {
  constexpr std::optional<Errc> none;
  const MemoryTape records = MemoryTape().open(0).write(1, "ask").read(2, "answer").close(3);
  const TapePaths paths = tape(records, {.device = "d", .driver = "p", .id = "0123"});
  EXPECT_EQ(checked(paths), std::pair(true, none));
  const Bytes sound = test::read_file(paths.read);
  Bytes other = sound;
  other.back() ^= 1U;
  test::write_file(paths.read, other);
  EXPECT_EQ(checked(paths), std::pair(true, std::optional(Errc::damaged_tape)));
  test::write_file(paths.read, sound);
  const Bytes events = test::read_file(paths.events);
  test::write_file(paths.events, as_bytes(std::string(as_text(events)) + "nonsense\n"));
  EXPECT_EQ(checked(paths), std::pair(false, std::optional(Errc::damaged_tape)));
  test::write_file(paths.events, as_bytes("no events\n"));
  EXPECT_EQ(checked(paths), std::pair(false, std::optional(Errc::damaged_tape)));
  EXPECT_EQ(checked(literal_tape(dir / "none")), std::pair(false, std::optional(Errc::usage)));
}

TEST_F(TapeFactsTest, ACheckIsGivenUpNowAndThen) {
  MemoryTape records;
  for (unsigned n = 0; n < 2 * kRecordsBetweenLooks + 1; ++n) records.read(n, "x");
  const TapePaths paths = tape(records);
  int asked = 0;
  EXPECT_TRUE(check_tape(paths, [&asked] { return ++asked > 2; })) << "it is read by then";
  EXPECT_EQ(asked, 2);
  asked = 0;
  EXPECT_FALSE(check_tape(paths, [&asked] { return ++asked > 1; }));
  EXPECT_EQ(asked, 2);
}

std::optional<LineSettings> own_of(const std::string& device) {
  return own_settings(DeviceLine{}, TapeHeader{.device = device, .driver = "pty"});
}

TEST(OwnSettings, AreThoseThatAnOlderRecorderOpenedTheDeviceWith) {
  const auto own = own_of("serial:/dev/ttyS0,baud=115200,parity=even,databits=7,stopbits=2,timeout=3");
  ASSERT_TRUE(own.has_value());
  EXPECT_EQ(own->baud, 115200U);
  EXPECT_EQ(own->parity, Parity::even);
  EXPECT_EQ(own->data_bits, 7U);
  EXPECT_EQ(own->stop_bits, 2U);
  EXPECT_FALSE(own->hw_flow);
  EXPECT_TRUE(own_of("serial:/dev/ttyS0,hwflowctrl")->hw_flow);
  EXPECT_EQ(own_of("serial:/dev/ttyS0")->baud, 9600U);
}

TEST(OwnSettings, AreNotKnownOfAnotherPortOrOfNone) {
  EXPECT_EQ(own_settings(DeviceLine{}, std::nullopt), std::nullopt);
  EXPECT_EQ(own_of("tcp:host:4000,baud=300"), std::nullopt);
  EXPECT_EQ(own_of("serial:/dev/ttyS0,baud=none"), std::nullopt);
}

TEST(OwnSettings, WhatTheTapeTellsComesFirst) {
  DeviceLine line;
  line.on_event(event::Settings{Side::device, SeenSettings{.baud = 300}, {}}, true);
  const auto own = own_settings(line, TapeHeader{.device = "serial:/dev/ttyS0,baud=1200", .driver = "pty"});
  ASSERT_TRUE(own.has_value());
  EXPECT_EQ(own->baud, 300U);
}

}  // namespace
}  // namespace porttape
