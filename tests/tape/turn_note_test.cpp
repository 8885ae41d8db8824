#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event_file.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/tape/turn_pairs.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TurnNote note_of_line(const std::string& line) {
  const auto decoded = decode_event(line);
  if (!decoded) throw std::runtime_error(decoded.error().message);
  Turn turn;
  turn.at = turn.until = decoded->at;
  turn.event = decoded->what;
  turn.line = line;
  return note_of(turn);
}
TurnNote note_of_event(std::int64_t us, const Event& event) {
  std::string line = encode(tape_time_us(us), event);
  line.pop_back();
  return note_of_line(line);
}

TEST(TurnNote, AnEventSaysTheSameAtAnyTimeAndCarriedOrNot) {
  const TurnNote one = note_of_line(R"({"t_us":5,"event":"mark","text":"x"})");
  EXPECT_EQ(one.digest, note_of_line(R"({"t_us":70,"event":"mark","text":"x"})").digest);
  EXPECT_EQ(one.digest, note_of_line(R"({"t_us":5,"event":"mark","text":"x","carried":true})").digest);
  EXPECT_EQ(one.digest, note_of_line(R"({ "t_us" : 5, "event":"mark", "text":"x"})").digest);
  EXPECT_NE(one.digest, note_of_line(R"({"t_us":5,"event":"mark","text":"y"})").digest);
  EXPECT_EQ(note_of_line(R"({"event":"mark","t_us":5,"text":"x"})").digest,
            note_of_line(R"({"event":"mark","t_us":6,"text":"x"})").digest);
  EXPECT_TRUE(one.is_event);
}

TEST(TurnNote, HowLongADrainTookAndWhenAGapBeganDoNotMatter) {
  EXPECT_EQ(note_of_event(5, event::Drain{Micros(1)}).digest,
            note_of_event(6, event::Drain{Micros(2)}).digest);
  const std::uint64_t gap = note_of_event(5, event::Gap{7, tape_time_us(1), "why"}).digest;
  EXPECT_EQ(gap, note_of_event(6, event::Gap{7, tape_time_us(2), "why"}).digest);
  EXPECT_NE(gap, note_of_event(5, event::Gap{8, tape_time_us(1), "why"}).digest);
  EXPECT_NE(gap, note_of_event(5, event::Gap{7, tape_time_us(1), "not"}).digest);
}

TEST(TurnNote, EventsOfOneKindAndLineAndSideStandForEachOther) {
  const auto question = [](const Event& event) { return note_of_event(5, event).question; };
  using Name = LineSignal::Name;
  EXPECT_EQ(question(event::Mark{"a"}), question(event::Mark{"b"}));
  EXPECT_NE(question(event::Mark{"a"}), question(event::Open{}));
  EXPECT_EQ(question(event::Modem{Name::dtr, true, {}}), question(event::Modem{Name::dtr, false, {}}));
  EXPECT_NE(question(event::Modem{Name::dtr, true, {}}), question(event::Modem{Name::rts, true, {}}));
  const auto settings = [&](std::optional<Side> by, unsigned baud) {
    return question(event::Settings{by, {.baud = baud}, {}});
  };
  EXPECT_EQ(settings(Side::driver, 1), settings(Side::driver, 2));
  EXPECT_NE(settings(Side::driver, 1), settings(Side::device, 1));
  EXPECT_NE(settings(Side::driver, 1), settings({}, 1));
  EXPECT_NE(settings(Side::device, 1), settings({}, 1));
}

TEST(TurnNote, OpensAndClosesHaveAPlaceAndOtherEventsHaveNone) {
  EXPECT_TRUE(note_of_event(5, event::Open{}).is_place);
  EXPECT_TRUE(note_of_event(5, event::Close{}).is_place);
  EXPECT_FALSE(note_of_event(5, event::Mark{"a"}).is_place);
  EXPECT_FALSE(note_of_event(5, event::DeviceBack{}).is_place);
}

TEST(TurnNote, OnlySampledSettingsMayBeAPlaceAway) {
  EXPECT_TRUE(note_of_event(5, event::Settings{{}, {}, SettingsOrder::sampled}).sampled);
  EXPECT_FALSE(note_of_event(5, event::Settings{{}, {}, SettingsOrder::exact}).sampled);
  EXPECT_FALSE(note_of_event(5, event::Settings{}).sampled);
  EXPECT_FALSE(note_of_event(5, event::Mark{"a"}).sampled);
}

Turn exchange_of(std::string_view writes, std::string_view reads) {
  Turn turn;
  turn.kind = Turn::Kind::exchange;
  turn.writes = test::bytes_of(writes);
  turn.reads = test::bytes_of(reads);
  return turn;
}

TEST(TurnNote, OfAnExchangeBothDirectionsAndWhereTheyPartMatter) {
  const TurnNote one = note_of(exchange_of("ab", "cd"));
  EXPECT_FALSE(one.is_event);
  EXPECT_TRUE(one.is_place);
  EXPECT_EQ(one.answer_us, -1);
  EXPECT_EQ(one.digest, note_of(exchange_of("ab", "cd")).digest);
  for (const auto& [writes, reads] : {std::pair("a", "bcd"), std::pair("abc", "d"), std::pair("ab", "ce"),
                                      std::pair("aa", "cd"), std::pair("", "abcd"), std::pair("cd", "ab")})
    EXPECT_NE(one.digest, note_of(exchange_of(writes, reads)).digest) << writes;
  EXPECT_EQ(one.question, note_of(exchange_of("ab", "other")).question);
  EXPECT_NE(one.question, note_of(exchange_of("aa", "cd")).question);
  Turn timed = exchange_of("ab", "cd");
  timed.wait = Micros(5);
  timed.answer = Micros(7);
  EXPECT_EQ(note_of(timed).wait_us, 5);
  EXPECT_EQ(note_of(timed).answer_us, 7);
  EXPECT_EQ(note_of(timed).digest, one.digest);
}

// Turns by letters: capital ones are events, which have no place; the same letter says the same.
TurnNotes turns_by_letters(std::string_view letters) {
  TurnNotes notes;
  for (const char letter : letters) {
    TurnNote note;
    note.digest = static_cast<std::uint64_t>(letter);
    note.question = static_cast<std::uint32_t>(letter);
    note.is_event = note.sampled = letter >= 'A' && letter <= 'Z';
    note.is_place = !note.is_event;
    note.sampled = false;
    notes.push_back(note);
  }
  return notes;
}
// "in order one/other; alone one/other; moved or changed".
std::string paired(std::string_view one, std::string_view other) {
  const TurnNotes mine = turns_by_letters(one);
  const TurnNotes theirs = turns_by_letters(other);
  const TurnPairs pairs(mine, theirs);
  std::string text;
  for (std::uint32_t i = 0; i < mine.size(); ++i)
    text += pairs.in_order(i) ? '=' : pairs.is_alone(i) ? '-' : '~';
  text += ' ';
  for (std::uint32_t k = 0; k < theirs.size(); ++k)
    text += pairs.other_in_order(k) ? '=' : pairs.other_is_alone(k) ? '-' : '~';
  for (const auto& [to, from, moved] : pairs.crossings())
    text += (moved ? " moved " : " changed ") + std::to_string(from) + std::to_string(to);
  return text;
}

TEST(TurnPairs, WhatIsEqualIsPairedInOrder) {
  EXPECT_EQ(paired("abc", "abc"), "=== ===");
  EXPECT_EQ(paired("", ""), " ");
  EXPECT_EQ(paired("abc", ""), "--- ");
  EXPECT_EQ(paired("", "abc"), " ---");
  EXPECT_EQ(paired("abc", "ac"), "=-= ==");
  EXPECT_EQ(paired("ac", "abc"), "== =-=");
}

TEST(TurnPairs, WhatIsLeftInOnePlaceOfBothIsOneThatIsChanged) {
  EXPECT_EQ(paired("axc", "ayc"), "=== ===");
  EXPECT_EQ(paired("axyc", "azc"), "==-= ===");
  EXPECT_EQ(paired("azc", "axyc"), "=== ==-=");
  EXPECT_EQ(paired("x", "y"), "= =");
}

TEST(TurnPairs, WhatStandsElsewhereWasMoved) {
  EXPECT_EQ(paired("xabc", "abcx"), "~=== ===~ moved 03");
  EXPECT_EQ(paired("abcx", "xabc"), "===~ ~=== moved 30");
  EXPECT_EQ(paired("xabcy", "yabcx"), "~===~ ~===~ moved 40 moved 04");
}

TEST(TurnPairs, OneOfEqualTurnsGoesBesideWhatHasNoPartner) {
  EXPECT_EQ(paired("aabb", "abbb"), "==== ====");
  EXPECT_EQ(paired("abbb", "aabb"), "==== ====");
  EXPECT_EQ(paired("caab", "cxab"), "==== ====");
  EXPECT_EQ(paired("aaab", "aaxb"), "==== ====");
  EXPECT_EQ(paired("baaac", "bxaac"), "===== =====");
  EXPECT_EQ(paired("baac", "baaac"), "==== ===-=");
}

TEST(TurnPairs, EventsArePairedBehindOnePlaceInAnyOrderOrMoved) {
  EXPECT_EQ(paired("aXYb", "aYXb"), "=~~= =~~=");
  EXPECT_EQ(paired("Xab", "abX"), "~== ==~ moved 02");
  EXPECT_EQ(paired("aXb", "ab"), "=-= ==");
  EXPECT_EQ(paired("aXXb", "aXb"), "=~-= =~=");
  EXPECT_EQ(paired("aXbY", "aYbX"), "=~=~ =~=~ moved 31 moved 13");
}

TEST(TapeReaderTells, TheHeadersLineAndItsEnd) {
  const std::string header = "{\"format\":\"porttape-events\", \"version\":1}";
  const auto open = [&](const std::optional<std::string>& events, const TapeReader::Options& options) {
    TapeSources sources{test::memory("r", test::block_bytes({{1, "a"}})), nullptr, nullptr};
    if (events) sources.events = test::memory("e", test::bytes_of(*events));
    return TapeReader::from_sources(std::move(sources), options);
  };
  auto reader = open(header + "\n", {});
  ASSERT_TRUE(reader);
  EXPECT_EQ(reader->header_line(), header);
  EXPECT_TRUE(reader->header());
  EXPECT_FALSE(reader->came_to_end());
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 1 a"));
  EXPECT_TRUE(reader->came_to_end());
  EXPECT_TRUE(reader->rewind());
  EXPECT_FALSE(reader->came_to_end());
  reader = open(std::nullopt, {});
  EXPECT_EQ(reader->header_line(), "");
  EXPECT_FALSE(reader->has_events());
  EXPECT_EQ(open("x\n", {}).error().code, Errc::damaged_tape);
  reader = open("x\n", {.events_may_fail = true});
  ASSERT_TRUE(reader);
  EXPECT_EQ(reader->header(), std::nullopt);
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 1 a", HasSubstr("error: e is not an events file")));
  reader = open(header + "\nx\n", {.events_may_fail = true});
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 1 a", HasSubstr("error: e is damaged in line 2")));
  reader = open(header + "\nx\n", {});
  EXPECT_THAT(test::read_all(*reader), ElementsAre(HasSubstr("error: e is damaged in line 2")));
  reader = open(header + "\n{\"t_us\":5,\"event\":\"mark\"}\n", {.select = TapeReader::Select::events_only});
  EXPECT_THAT(test::read_all(*reader), ElementsAre("mark 5"));
}

TEST(TapeReaderTells, BesideAnEventsFileWhatCannotBeReadIsDamage) {
  const auto code = [](const std::string& events) {
    return TapeReader::from_sources({test::memory("r", test::bytes_of("no blocks at all, but text")), nullptr,
                                     test::memory("e", test::bytes_of(events))})
        .error();
  };
  const std::string header = "{\"format\":\"porttape-events\",\"version\":1}\n";
  EXPECT_EQ(code(header),
            make_error(Errc::damaged_tape, "r is not a file of a tape: it does not begin with a block"));
  EXPECT_EQ(code("x\n").code, Errc::not_a_tape);
  EXPECT_EQ(code("").code, Errc::not_a_tape);
}

TEST(NewFileTells, WhatNamesItCannotHave) {
  const test::TempDir dir;
  EXPECT_EQ(NewFile::create("", false).error(), make_error(Errc::usage, "the file's name is empty"));
  test::write_file(dir / "x", {});
  EXPECT_EQ(NewFile::create(dir / "x", false).error(),
            make_error(Errc::usage, "'" + (dir / "x") + "' exists already; name another, or --overwrite"));
  EXPECT_EQ(NewFile::create(dir.path().string(), true).error(),
            make_error(Errc::usage, "'" + dir.path().string() + "' is no regular file; name another"));
  EXPECT_EQ(NewFile::create(dir / "a b/x", false).error(),
            make_error(Errc::usage, "'" + (dir / "a b/x") + "': its folder does not exist; type mkdir -p '" +
                                        (dir / "a b") + "'"));
  EXPECT_EQ(NewFile::create(dir / "x/y", false).error(),
            make_error(Errc::usage, "'" + (dir / "x/y") + "': its folder: Not a directory"));
}

TEST(NewFileTells, WhatIsInMemory) {
  NewFile file = NewFile::in_memory();
  const std::string large(1'000'000, 'x');
  EXPECT_TRUE(file.add(large));
  EXPECT_TRUE(file.add(as_bytes("y")));
  EXPECT_TRUE(file.finish());
  EXPECT_EQ(file.size(), large.size() + 1);
  EXPECT_EQ(file.name(), "memory");
  EXPECT_EQ(file.take(), large + "y");
}

TEST(NewFileTells, WhenWhatItIsToReplaceIsGoneOrANewOneItTakesItsPlace) {
  const test::TempDir dir;
  test::write_file(dir / "x", test::bytes_of("old"));
  for (const bool again : {false, true}) {
    auto file = NewFile::create(dir / "x", true);
    ASSERT_TRUE(file && file->add(std::string_view("new")));
    std::filesystem::remove(dir / "x");
    if (again) test::write_file(dir / "x", test::bytes_of("theirs"));
    EXPECT_TRUE(file->finish());
    const Bytes bytes = test::read_file(dir / "x");
    EXPECT_EQ(as_text(bytes), "new");
  }
}

}  // namespace
}  // namespace porttape
