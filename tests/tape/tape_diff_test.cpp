#include "libport/tape/tape_diff.hpp"

#include <algorithm>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/cut_tape.hpp"
#include "libport/tape/difference_reader.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::MemoryTape;
using testing::ElementsAre;
using testing::ElementsAreArray;
using testing::HasSubstr;
using testing::IsEmpty;

std::string turn_name(const Turn* turn) {
  if (turn == nullptr) return "-";
  if (turn->is_event()) return std::string(name_of(turn->event));
  return std::to_string(turn->exchange);
}

class TapeDiffTest : public testing::Test {
 protected:
  TapePaths put(const MemoryTape& tape) {
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++tapes))), tape);
  }
  // "changed 2 3": the numbers of the exchanges of both tapes, or the kinds of the events.
  std::vector<std::string> differences(const MemoryTape& one, const MemoryTape& other,
                                       const TapeDiffOptions& options = {}) {
    const TapePaths first = put(one);
    const TapePaths second = put(other);
    const auto diff = diff_tapes(first, second, options);
    if (!diff) return {diff.error().message};
    same = diff->same;
    std::vector<std::string> texts;
    auto reader = DifferenceReader::open(first, second, diff->differences, {.events = diff->events});
    for (std::size_t i = 0; i < diff->differences.size(); ++i) {
      const auto next = reader->next();
      if (!next) return {next.error().message};
      texts.push_back(std::string(to_string(next->what.kind)) + " " + turn_name(next->one) + " " +
                      turn_name(next->other));
    }
    return texts;
  }

  test::TempDir dir;
  int tapes = 0;
  std::uint64_t same = 0;
};

TEST_F(TapeDiffTest, TheCutIntoBlocksAndSmallTimesDoNotMatter) {
  EXPECT_THAT(
      differences(MemoryTape().open(0).write(100, "ab").read(200, "AB").close(300),
                  MemoryTape().open(0).write(150, "a").write(160, "b").read(90'000, "AB").close(99'000)),
      IsEmpty());
  EXPECT_EQ(same, 1U);
}

TEST_F(TapeDiffTest, WhereTheQuestionEndsMatters) {
  EXPECT_THAT(differences(MemoryTape().write(1, "ab").read(2, "c"), MemoryTape().write(1, "a").read(2, "bc")),
              ElementsAre("changed 1 1"));
}

TEST_F(TapeDiffTest, AnswersAreComparedByTheirQuestions) {
  const MemoryTape one = MemoryTape()
                             .write(1, "speed")
                             .read(2, "10")
                             .write(3, "name")
                             .read(4, "x")
                             .write(5, "speed")
                             .read(6, "12");
  const MemoryTape other = MemoryTape()
                               .write(1, "hello")
                               .read(2, "hi")
                               .write(3, "speed")
                               .read(4, "11")
                               .write(5, "name")
                               .read(6, "y")
                               .write(7, "speed")
                               .read(8, "13");
  EXPECT_THAT(differences(one, other), ElementsAre("added - 1", "changed 1 2", "changed 2 3", "changed 3 4"));
}

MemoryTape polled(std::string_view answers) {
  MemoryTape tape;
  std::int64_t at = 0;
  for (const char answer : answers) {
    tape.write(at, "Q").read(at + 1, std::string(1, answer));
    at += 10;
  }
  return tape;
}

TEST_F(TapeDiffTest, OneOfEqualAnswersThatIsAnothersIsChanged) {
  EXPECT_THAT(differences(polled("1155"), polled("1555")), ElementsAre("changed 2 2"));
  EXPECT_THAT(differences(polled("1555"), polled("1155")), ElementsAre("changed 2 2"));
  EXPECT_THAT(differences(polled("122223"), polled("112223")), ElementsAre("changed 2 2"));
  EXPECT_THAT(differences(polled("111255"), polled("11155")), ElementsAre("missing 4 -"));
}

TEST_F(TapeDiffTest, SlowerAndFasterByMoreThanTheMargin) {
  const MemoryTape one = MemoryTape().write(0, "a").read(200'000, "A").write(500'000, "b").read(500'010, "B");
  const MemoryTape other =
      MemoryTape().write(0, "a").read(90'000, "A").write(600'000, "b").read(600'010, "B");
  EXPECT_THAT(differences(one, other), ElementsAre("faster 1 1", "slower 2 2"));
  EXPECT_THAT(differences(one, other, {.margin = Micros(210'000), .progress = {}}), IsEmpty());
  EXPECT_THAT(differences(one, other, {.margin = std::nullopt, .progress = {}}), IsEmpty());
}

TEST_F(TapeDiffTest, EventsCountWithWhatTheySayAndNotWithTheirTimes) {
  const auto tape = [](std::int64_t later, std::int64_t baud, bool on) {
    return MemoryTape()
        .open(0)
        .event(10 + later, event::Settings{Side::driver, {.baud = baud}, {}})
        .write(100 + later, "a")
        .gap(110 + later, 7, 105 + later)
        .read(120 + later, "A")
        .event(130 + later, signal_event({Side::device, {LineSignal::Name::cts, on}}))
        .event(140 + later, event::Drain{Micros(later)})
        .close(200 + later);
  };
  EXPECT_THAT(differences(tape(0, 9600, true), tape(50, 9600, true)), IsEmpty());
  EXPECT_THAT(differences(tape(0, 9600, true), tape(0, 300, false)),
              ElementsAre("changed settings settings", "changed modem modem"));
  EXPECT_THAT(differences(tape(0, 9600, true), tape(0, 300, false), {.events = false, .progress = {}}),
              IsEmpty());
}

TEST_F(TapeDiffTest, WhereOneTapeHasNoEventsFileTheyAreUnknown) {
  const TapePaths one = put(MemoryTape().open(0).write(1, "a").read(2, "A").close(3));
  const TapePaths other = put(MemoryTape().write(1, "a").read(2, "A"));
  EXPECT_EQ(diff_tapes(one, other, {})->differences.size(), 2U);
  std::filesystem::remove(other.events);
  const auto diff = diff_tapes(one, other, {});
  EXPECT_TRUE(diff->equal());
  EXPECT_FALSE(diff->events);
}

TEST_F(TapeDiffTest, WhatIsCarriedOntoAPartIsTheSame) {
  const TapePaths one = put(MemoryTape()
                                .open(0)
                                .event(1, event::Settings{Side::device, {.baud = 300}, {}})
                                .write(10, "a")
                                .read(20, "A"));
  const TapePaths part = literal_tape(dir / "part");
  ASSERT_TRUE(cut_tape(
      one, part, {.range = TimeRange{tape_time_us(10), TapeTime::max()}, .writer = {}, .progress = {}}));
  EXPECT_TRUE(diff_tapes(one, part, {})->equal());
}

TEST_F(TapeDiffTest, TheOrderOfEventsBetweenTwoExchangesDoesNotMatter) {
  const auto tape = [](std::int64_t flush, std::int64_t mark, std::int64_t settings) {
    return MemoryTape()
        .open(0)
        .event(std::min(flush, mark),
               flush < mark ? Event(event::Flush{FlushQueue::in}) : Event(event::Mark{"m"}))
        .event(std::max(flush, mark),
               flush < mark ? Event(event::Mark{"m"}) : Event(event::Flush{FlushQueue::in}))
        .write(100, "a")
        .event(settings, event::Settings{Side::driver, {.baud = 300}, SettingsOrder::sampled})
        .read(400, "A")
        .write(500, "b");
  };
  EXPECT_THAT(differences(tape(10, 20, 150), tape(20, 10, 150)), IsEmpty());
}

TEST_F(TapeDiffTest, SampledSettingsMayComeATurnLateAndOthersMayNot) {
  const auto tape = [](std::size_t behind, std::optional<SettingsOrder> order) {
    MemoryTape made;
    made.open(0);
    for (std::size_t i = 0; i < 4; ++i) {
      made.write(static_cast<std::int64_t>(100 * i + 10), std::string(1, static_cast<char>('a' + i)));
      made.read(static_cast<std::int64_t>(100 * i + 20), "ok");
      if (i == behind)
        made.event(static_cast<std::int64_t>(100 * i + 30),
                   event::Settings{Side::driver, {.baud = 300}, order});
    }
    return made;
  };
  EXPECT_THAT(differences(tape(1, SettingsOrder::sampled), tape(2, SettingsOrder::sampled)), IsEmpty());
  EXPECT_THAT(differences(tape(2, SettingsOrder::sampled), tape(1, SettingsOrder::sampled)), IsEmpty());
  // A pty that is looked at late by one recorder may be looked at in time by the other.
  for (const std::size_t behind : {0U, 1U, 2U}) {
    EXPECT_THAT(differences(tape(1, SettingsOrder::exact), tape(behind, SettingsOrder::sampled)), IsEmpty());
    EXPECT_THAT(differences(tape(behind, SettingsOrder::sampled), tape(1, SettingsOrder::exact)), IsEmpty());
    EXPECT_THAT(differences(tape(1, std::nullopt), tape(behind, SettingsOrder::sampled)), IsEmpty());
  }
  EXPECT_THAT(differences(tape(1, std::nullopt), tape(1, SettingsOrder::exact)), IsEmpty());
  EXPECT_THAT(differences(tape(0, SettingsOrder::sampled), tape(2, SettingsOrder::sampled)),
              ElementsAre("moved settings settings"));
  EXPECT_THAT(differences(tape(1, SettingsOrder::exact), tape(2, SettingsOrder::exact)),
              ElementsAre("moved settings settings"));
}

TEST_F(TapeDiffTest, AnOpenMoreIsADifference) {
  EXPECT_THAT(
      differences(MemoryTape().open(0).write(1, "a").read(2, "A").write(3, "b").close(4),
                  MemoryTape().open(0).write(1, "a").read(2, "A").close(3).open(4).write(5, "b").close(6)),
      ElementsAre("added - close", "added - open"));
}

TEST_F(TapeDiffTest, ATapeWithoutWritesIsComparedInParts) {
  std::string stream;
  for (int i = 0; i < 1000; ++i)
    stream += "$GPGGA,line " + std::to_string(i * 7919 % 10007) + " of a stream,*00\r\n";
  std::string changed = stream;
  changed[20'000] = '?';
  changed.erase(30'000, 3);
  const auto found = differences(MemoryTape().read(1, stream), MemoryTape().read(1, changed));
  EXPECT_THAT(found, ElementsAre("changed 0 0", "changed 0 0"));
  EXPECT_GT(same, 300U);
}

TEST_F(TapeDiffTest, DamageIsAnError) {
  const TapePaths one = put(MemoryTape().read(1, "a").read(2, "b"));
  Bytes bytes = test::read_file(one.read);
  bytes.at(13 + 4) = 0xff;
  test::write_file(one.read, bytes);
  const auto diff = diff_tapes(put(MemoryTape().read(1, "a")), one, {});
  ASSERT_FALSE(diff);
  EXPECT_EQ(diff.error().code, Errc::damaged_tape);
}

// An exchange of a tape that a test changes.
struct Said {
  int name = 0;
  std::string answer;
  std::int64_t pause = 1000;
  std::int64_t latency = 500;
};

MemoryTape tape_of(const std::vector<Said>& all) {
  MemoryTape tape;
  std::int64_t now = 0;
  for (const Said& each : all) {
    now += each.pause;
    tape.write(now, "ask " + std::to_string(each.name % 5) + "\n");
    now += each.latency;
    tape.read(now, each.answer.substr(0, 3)).read(now + 1, each.answer.substr(3));
    ++now;
  }
  return tape;
}

TEST_F(TapeDiffTest, NamesExactlyWhatWasDoneToATape) {
  std::mt19937 random(20260202);
  for (int round = 0; round < 150; ++round) {
    const int size = 40 + static_cast<int>(random() % 400);
    std::vector<Said> one;
    for (int i = 0; i < size; ++i) one.push_back({i, "answer " + std::to_string(i)});
    std::vector<Said> other;
    std::vector<std::string> wanted;
    std::vector<std::pair<int, Said>> moving;  // to behind which, what
    // Apart from each other, so that there is one way to say it.
    for (int i = 0; i < size; ++i) {
      const std::string number = std::to_string(i + 1);
      const int place = static_cast<int>(other.size()) + 1;
      Said said = one[static_cast<std::size_t>(i)];
      const auto what = i % 8 == 4 ? random() % 7 : 6;
      if (what == 0) {
        wanted.push_back("missing " + number + " -");
        continue;
      }
      if (what == 1) {
        other.push_back({i + 1, "new " + number});
        wanted.push_back("added - " + std::to_string(place));
      } else if (what == 2) {
        said.answer += "!";
        wanted.push_back("changed " + number + " " + std::to_string(place));
      } else if (what == 3) {
        said.latency += 100'001;
        wanted.push_back("slower " + number + " " + std::to_string(place));
      } else if (what == 4) {
        said.pause += 100'001;
        wanted.push_back("slower " + number + " " + std::to_string(place));
      } else if (what == 5 && i + 8 < size && moving.empty()) {
        moving.emplace_back(i + 4, said);
        continue;
      }
      other.push_back(said);
      if (!moving.empty() && moving.front().first == i) {
        wanted.push_back("moved " + std::to_string(i - 3) + " " + std::to_string(other.size() + 1));
        other.push_back(moving.front().second);
        moving.clear();
      }
    }
    EXPECT_THAT(differences(tape_of(one), tape_of(other)), ElementsAreArray(wanted)) << "round " << round;
  }
}

TEST_F(TapeDiffTest, OfRandomTapesBothWaysMirrorAndItselfIsTheSame) {
  std::mt19937 random(20260203);
  for (int round = 0; round < 200; ++round) {
    const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    const test::RandomTapeShape shape{
        .sessions = true, .hang_ups = true, .half_closes = true, .gaps = true, .signals = true};
    const TapePaths one = put(test::random_tape(choose, shape));
    const TapePaths other = put(test::random_tape(choose, shape));
    EXPECT_TRUE(diff_tapes(one, one, {})->equal());
    const auto there = diff_tapes(one, other, {});
    const auto back = diff_tapes(other, one, {});
    ASSERT_TRUE(there && back);
    // Each turn is in one difference or in none.
    using Kind = TapeDifference::Kind;
    const auto turns = [](const ComparedTape& tape) { return tape.turns + tape.events; };
    EXPECT_EQ(turns(there->one) - there->count(Kind::missing),
              turns(there->other) - there->count(Kind::added));
    EXPECT_EQ(there->count(Kind::missing) > 0 || there->count(Kind::added) > 0 ||
                  there->count(Kind::changed) > 0 || there->count(Kind::moved) > 0,
              back->count(Kind::missing) > 0 || back->count(Kind::added) > 0 ||
                  back->count(Kind::changed) > 0 || back->count(Kind::moved) > 0);
  }
}

}  // namespace
}  // namespace porttape
