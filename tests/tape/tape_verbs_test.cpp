// Tapes that are made of others, or compared, where there is little or much of something.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/block_file.hpp"
#include "libport/tape/cut_tape.hpp"
#include "libport/tape/difference_reader.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/merge_tapes.hpp"
#include "libport/tape/recover_tape.hpp"
#include "libport/tape/split_tape.hpp"
#include "libport/tape/tape_group.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class TapeVerbs : public testing::Test {
 protected:
  TapePaths put(const std::string& name, const MemoryTape& tape,
                const TapeHeader& header = {.device = "d", .driver = "p"}) {
    return test::write_tape(literal_tape(dir / name), tape, header);
  }
  TapePaths next_name() { return literal_tape(dir / ("made" + std::to_string(++made_))); }
  std::string why(const TapePaths& source, const CutRange& range) {
    const auto done =
        cut_tape(source, next_name(), {.range = range, .writer = {.sync = false}, .progress = {}});
    return done ? "" : done.error().message;
  }
  std::vector<std::string> kept(const TapePaths& source, const CutRange& range) {
    const TapePaths to = next_name();
    const auto done = cut_tape(source, to, {.range = range, .writer = {.sync = false}, .progress = {}});
    return done ? test::lines_on(to) : std::vector<std::string>{done.error().message};
  }
  static std::uint64_t size_of(const TapePaths& tape) {
    return fs::file_size(tape.read) + fs::file_size(tape.write) + fs::file_size(tape.events);
  }
  // Without its end.
  static void kill(const TapePaths& tape) {
    const std::string text(as_text(test::read_file(tape.events)));
    const std::size_t end = text.rfind("{\"t_us\"");
    test::write_file(tape.events, as_bytes(text.substr(0, end)));
  }
  static bool ends(const TapePaths& tape) {
    return std::string(as_text(test::read_file(tape.events))).find("\"event\":\"end\"") != std::string::npos;
  }

  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(TapeVerbs, ACutSaysWhatThereIsInsteadOfWhatIsNotThere) {
  const TapePaths one = put("one", MemoryTape().write(1'500'000, "a").read(2'000'000, "A"));
  EXPECT_EQ(why(one, ExchangeRange{2, 2}), "nothing is cut out of 'one': it has only 1 exchange");
  EXPECT_EQ(
      why(one, TimeRange{tape_time_us(3'000'000), tape_time_us(4'000'001)}),
      "nothing is cut out of 'one': it has nothing from 3.000000 s to 4.000001 s: it ends at 2.000001 s");
  EXPECT_EQ(why(one, TimeRange{tape_time_us(3'000'000), TapeTime::max()}),
            "nothing is cut out of 'one': it has nothing from 3.000000 s on: it ends at 2.000001 s");
  EXPECT_EQ(why(one, MarkRange{"m", {}}), "nothing is cut out of 'one': it has no mark 'm'; it has no marks");
  const TapePaths none = put("none", MemoryTape());
  EXPECT_EQ(why(none, MarkRange{}), "nothing is cut out of 'none': it is empty");
  EXPECT_EQ(why(none, ExchangeRange{}), "nothing is cut out of 'none': it has only 0 exchanges");
}

TEST_F(TapeVerbs, ACutNamesTheFirstFiveMarksAndKnows64) {
  MemoryTape five;
  MemoryTape six;
  MemoryTape many;
  for (int i = 1; i <= 65; ++i) {
    const event::Mark mark{"mark number " + std::to_string(i)};
    if (i <= 5) five.event(i, mark);
    if (i <= 6) six.event(i, mark);
    many.event(i, i == 65 ? event::Mark{"beyond"} : mark);
  }
  const std::string told =
      "'mark number 1', 'mark number 2', 'mark number 3', 'mark number 4', 'mark number 5'";
  EXPECT_THAT(why(put("five", five), MarkRange{"x", {}}), testing::EndsWith("; its marks are " + told));
  EXPECT_THAT(why(put("six", six), MarkRange{"x", {}}), testing::EndsWith("; its marks are " + told + ", …"));
  const TapePaths all = put("many", many);
  EXPECT_THAT(why(all, MarkRange{"beyonf", {}}), testing::Not(HasSubstr("did you mean")));
  EXPECT_THAT(why(all, MarkRange{"mark number 65", {}}), HasSubstr("did you mean 'mark number "));
  EXPECT_THAT(kept(all, MarkRange{"beyond", {}}), testing::SizeIs(1));
}

TEST_F(TapeVerbs, ACutByMarksBeginsAndEndsWithThem) {
  const TapePaths tape = put("t", MemoryTape()
                                      .read(1, "a")
                                      .event(2, event::Mark{"m"})
                                      .read(3, "b")
                                      .event(4, event::Mark{"m"})
                                      .read(5, "c")
                                      .event(6, event::Mark{"n"})
                                      .read(7, "d"));
  const std::string m2 = R"({"t_us":2,"event":"mark","text":"m"})";
  const std::string m4 = R"({"t_us":4,"event":"mark","text":"m"})";
  EXPECT_THAT(kept(tape, MarkRange{"m", "m"}), ElementsAre(m2, "r 3 b", m4));
  EXPECT_THAT(kept(tape, MarkRange{{}, "m"}), ElementsAre("r 1 a", m2));
  EXPECT_THAT(kept(tape, MarkRange{"n", {}}),
              ElementsAre(R"({"t_us":6,"event":"mark","text":"n"})", "r 7 d"));
  EXPECT_EQ(kept(tape, MarkRange{}), test::lines_on(tape));
  EXPECT_THAT(why(tape, MarkRange{{}, "o"}), HasSubstr("it has no mark 'o'; its marks are 'm', 'm', 'n'"));
  EXPECT_THAT(why(tape, MarkRange{"n", "m"}), HasSubstr("it has no mark 'm' behind 'n'"));
}

TEST_F(TapeVerbs, AnOpenOrACloseEndsAnExchangeForACutToo) {
  const TapePaths tape =
      put("t", MemoryTape().open(0).write(1, "a").close(2).open(3).write(4, "b").read(5, "B"));
  EXPECT_THAT(kept(tape, ExchangeRange{2, 2}), ElementsAre("w 4 b", "r 5 B"));
}

TEST_F(TapeVerbs, ABlockInPiecesIsCutWholeAndCountsOnce) {
  const std::string large(BlockFile::kBufferSize * 2, 'x');
  const TapePaths tape = put("t", MemoryTape().read(1, "a").read(2, large).read(3, "b"));
  const TapePaths to = next_name();
  std::uint64_t progress = 0;
  const auto done = cut_tape(tape, to,
                             {.range = TimeRange{tape_time_us(2), tape_time_us(3)},
                              .writer = {.sync = false},
                              .progress = [&](std::uint64_t bytes) { progress = bytes; }});
  ASSERT_TRUE(done);
  EXPECT_EQ(done->blocks, 1U);
  EXPECT_EQ(done->events, 0U);
  EXPECT_THAT(test::decode_independently(test::read_file(to.read)), ElementsAre(test::Block{2, large}));
  const std::string text(as_text(test::read_file(tape.events)));
  EXPECT_EQ(progress, size_of(tape) - text.find('\n') - 1) << "of all but the header line";
}

TEST_F(TapeVerbs, AMergedTapeEndsAsItsTapesDo) {
  const TapePaths one = put("one", MemoryTape().open(0).read(10, "a"));
  const TapePaths two = put("two", MemoryTape().open(0).read(20, "b"));
  const auto merge = [&](std::vector<Micros> offsets) {
    const TapePaths to = next_name();
    return merge_tapes({one, two}, to,
                       {.offsets = std::move(offsets), .writer = {.sync = false}, .progress = {}});
  };
  auto done = merge({Micros(5)});
  ASSERT_TRUE(done);
  EXPECT_EQ(done->placed, MergedTape::Placed::given);
  EXPECT_EQ(done->end, tape_time_us(26));
  EXPECT_EQ(done->blocks, 2U);
  EXPECT_EQ(done->events, 2U);
  EXPECT_TRUE(ends(done->paths));
  for (const TapePaths& killed : {two, one}) {
    kill(killed);
    done = merge({Micros(5)});
    ASSERT_TRUE(done);
    EXPECT_FALSE(ends(done->paths)) << killed.name();
  }
  fs::remove(one.events);
  fs::remove(two.events);
  done = merge({Micros(5)});
  ASSERT_TRUE(done);
  EXPECT_TRUE(ends(done->paths)) << "of tapes without events nothing is missing";
  EXPECT_THAT(merge({Micros(1), Micros(2)}).error().message,
              HasSubstr("2 offsets are given for 1 tapes behind the first"));
}

TEST_F(TapeVerbs, AMergedTapeKnowsThePreviousOfTheEarliestAndTellsItsProgress) {
  const TapePaths one = put("one", MemoryTape().read(10, "a"),
                            {.device = "d", .driver = "p", .previous = PreviousTape{"i", "n"}});
  const TapePaths two = put("two", MemoryTape().read(20, "b"));
  std::uint64_t progress = 0;
  const TapePaths to = next_name();
  ASSERT_TRUE(merge_tapes({one, two}, to,
                          {.offsets = {}, .writer = {.sync = false}, .progress = [&](std::uint64_t bytes) {
                             progress = bytes;
                           }}));
  EXPECT_EQ(header_of(to)->previous, (PreviousTape{"i", "n"}));
  EXPECT_EQ(header_of(to)->zero, std::nullopt);
  EXPECT_GT(progress, 2 * 13U);
  const auto taken = merge_tapes({one, two}, to, {.offsets = {}, .writer = {}, .progress = {}});
  EXPECT_EQ(taken.error().code, Errc::usage);
}

GroupedTape grouped(std::optional<TapeHeader> header) { return {literal_tape("x"), std::move(header), {}}; }

TEST_F(TapeVerbs, TapesBeginByTheClockOfOneBoot) {
  const auto of = [](const std::string& boot, std::int64_t us) {
    TapeHeader header{.device = "d", .driver = "p"};
    header.zero = TapeZero{"2024-05-06T07:08:09Z", us, boot};
    return grouped(header);
  };
  const auto begins = [](std::vector<GroupedTape> tapes) { return begins_by_clock(tapes); };
  EXPECT_THAT(*begins({of("b", 5), of("b", 8), of("b", 1)}), ElementsAre(Micros(0), Micros(3), Micros(-4)));
  EXPECT_FALSE(begins({of("b", 5), of("c", 8)}));
  EXPECT_FALSE(begins({of("", 5), of("", 8)}));
  EXPECT_FALSE(begins({of("b", 5), grouped({})}));
  EXPECT_FALSE(begins({grouped({}), of("b", 5)}));
  EXPECT_FALSE(begins({of("b", 5), grouped(TapeHeader{.device = "d", .driver = "p"})}));
  EXPECT_FALSE(begins({of("b", 0), of("b", 20'000'000'000'000'000)}));
}

TEST_F(TapeVerbs, TapesBeginAsThePartsOfOne) {
  const auto of = [](const std::string& by, const std::string& id, std::optional<Micros> from) {
    TapeHeader header{.device = "d", .driver = "p"};
    header.origin = TapeOrigin{by, {{id, "t"}}, from};
    return grouped(header);
  };
  const auto begins = [](std::vector<GroupedTape> tapes) { return begins_by_parts(tapes); };
  EXPECT_THAT(
      *begins({of("split", "i", Micros(5)), of("split", "i", Micros(9)), of("split", "i", Micros(2))}),
      ElementsAre(Micros(0), Micros(4), Micros(-3)));
  EXPECT_FALSE(begins({of("split", "i", Micros(5)), of("cut", "i", Micros(9))}));
  EXPECT_FALSE(begins({of("split", "i", Micros(5)), of("split", "j", Micros(9))}));
  EXPECT_FALSE(begins({of("split", "i", Micros(5)), of("split", "i", {})}));
  EXPECT_FALSE(begins({of("split", "i", Micros(5)), grouped({})}));
  EXPECT_FALSE(begins({of("split", "i", Micros(5)), grouped(TapeHeader{.device = "d", .driver = "p"})}));
  std::vector<GroupedTape> tapes{grouped({}), grouped({}), grouped({})};
  place_tapes(tapes, std::vector{Micros(5), Micros(-2), Micros(9)});
  EXPECT_EQ(tapes[0].at, Micros(7));
  EXPECT_EQ(tapes[1].at, Micros(0));
  EXPECT_EQ(tapes[2].at, Micros(11));
}

TEST_F(TapeVerbs, AMissingTapeOfAGroupIsItsError) {
  const TapePaths one = put("one", MemoryTape().read(1, "a"));
  EXPECT_EQ(grouped_tapes({one, literal_tape(dir / "none")}).error().code, Errc::usage);
  EXPECT_THAT(grouped_tapes({one, one}).error().message, HasSubstr("is given twice"));
}

class RecoverLimits : public TapeVerbs {
 protected:
  Result<RecoveredTape> recover(const TapePaths& source) {
    made = next_name();
    return recover_tape(source, made, {.writer = {.sync = false}, .progress = [this](std::uint64_t bytes) {
                                         progress = bytes;
                                       }});
  }
  TapePaths made;
  std::uint64_t progress = 0;
};

TEST_F(RecoverLimits, OfASoundTapeAllIsKeptAndTold) {
  const TapePaths source = put("t", MemoryTape().open(0).write(1, "a").read(2, "bc").close(3),
                               {.device = "d", .driver = "p", .previous = PreviousTape{"i", "n"}});
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->clean());
  EXPECT_EQ(done->blocks, 2U);
  EXPECT_EQ(done->events, 2U);
  EXPECT_THAT(done->notes, IsEmpty());
  EXPECT_EQ(header_of(made)->previous, (PreviousTape{"i", "n"}));
  EXPECT_TRUE(ends(made));
  const std::string text(as_text(test::read_file(source.events)));
  EXPECT_EQ(progress, size_of(source) - text.find('\n') - 1);
}

TEST_F(RecoverLimits, WithoutAnEndThereItHasNone) {
  const TapePaths source = put("t", MemoryTape().open(0).write(1, "a").close(3));
  kill(source);
  ASSERT_TRUE(recover(source));
  EXPECT_FALSE(ends(made));
  fs::remove(source.events);
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_TRUE(ends(made)) << "of whom nothing is known, who made it may have ended it";
  EXPECT_THAT(done->notes, ElementsAre("te is not there: nothing is known of opens and settings"));
  EXPECT_THAT(std::string(as_text(test::read_file(made.events))), testing::Not(HasSubstr("blocks")));
}

TEST_F(RecoverLimits, TheFirst64LossesAreToldAndAllCounted) {
  for (const int lost : {64, 65}) {
    const TapePaths source = literal_tape(dir / ("l" + std::to_string(lost)));
    test::write_file(source.read, test::block_bytes({{1, "a"}}));
    std::string text = encode(TapeHeader{.device = "d", .driver = "p"});
    for (int i = 0; i < lost; ++i) {
      text += "x\n";
      for (int k = 0; k < 4; ++k) text += encode(tape_time_us(i), event::Mark{"m"});
    }
    test::write_file(source.events, as_bytes(text));
    const auto done = recover(source);
    ASSERT_TRUE(done);
    EXPECT_EQ(done->loss_count, static_cast<std::uint64_t>(lost));
    EXPECT_EQ(done->losses.size(), 64U);
    EXPECT_THAT(done->losses[0], HasSubstr("line 2"));
  }
}

TEST_F(RecoverLimits, LinesThatAreLostAreToldTogether) {
  const TapePaths source = literal_tape(dir / "t");
  test::write_file(source.read, test::block_bytes({{1, "a"}}));
  test::write_file(source.events, as_bytes(encode(TapeHeader{.device = "d", .driver = "p"}) + "x\ny\n" +
                                           encode(tape_time_us(5), event::Mark{"m"})));
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses, ElementsAre(HasSubstr("2 lines from line 2 on")));
}

TEST_F(RecoverLimits, AFileThatIsNotThereIsANoteUnlessItHeldSomething) {
  const TapePaths source = put("t", MemoryTape().open(0).read(1, "abc").close(3));
  fs::remove(source.write);
  auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->notes, ElementsAre("tw is not there; it held nothing"));
  kill(source);
  done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->notes, ElementsAre("tw is not there"));
}

TEST_F(RecoverLimits, ATapeThatIsBeingWrittenIsLeftAlone) {
  const TapePaths live = literal_tape(dir / "live");
  const auto writer = TapeWriter::create(live, {"d", "p"}, {.sync = false});
  ASSERT_TRUE(writer);
  EXPECT_EQ(recover(live).error(),
            make_error(Errc::usage, "'" + live.name() + "' is being written; end its recorder first"));
}

class DiffLimits : public TapeVerbs {
 protected:
  std::vector<std::string> kinds(const MemoryTape& one, const MemoryTape& other) {
    const std::string number = std::to_string(++tapes);
    diff = *diff_tapes(put("a" + number, one), put("b" + number, other), {});
    std::vector<std::string> all;
    for (const TapeDifference& each : diff.differences) all.emplace_back(to_string(each.kind));
    return all;
  }
  TapeDiff diff;
  int tapes = 0;
};

TEST_F(DiffLimits, AnAnswerAtOnceIsOneAndNoneIsNotComparedWithAny) {
  EXPECT_THAT(kinds(MemoryTape().write(0, "a").read(0, "A"), MemoryTape().write(0, "a").read(200'000, "A")),
              ElementsAre("slower"));
  EXPECT_EQ(diff.differences[0].time, TapeDifference::Time::answer);
  EXPECT_THAT(kinds(MemoryTape().write(0, "a").read(200'000, "A"), MemoryTape().write(0, "a").read(0, "A")),
              ElementsAre("faster"));
  EXPECT_THAT(kinds(MemoryTape().write(0, "a"), MemoryTape().write(0, "a").read(200'000, "")), IsEmpty());
  EXPECT_THAT(kinds(MemoryTape().write(0, "a").read(200'000, ""), MemoryTape().write(0, "a")), IsEmpty());
}

TEST_F(DiffLimits, ATimeMayDifferByTheMarginAndNoMore) {
  EXPECT_THAT(kinds(MemoryTape().write(0, "a").read(5, "A"), MemoryTape().write(0, "a").read(100'005, "A")),
              IsEmpty());
  EXPECT_THAT(kinds(MemoryTape().write(0, "a").read(5, "A"), MemoryTape().write(0, "a").read(100'006, "A")),
              ElementsAre("slower"));
}

TEST_F(DiffLimits, TellsWhatEachTapeHolds) {
  (void)kinds(MemoryTape().open(0).write(1, "a").read(2, "A").write(3, "b"),
              MemoryTape().write(1, "a").read(2, "A"));
  EXPECT_EQ(diff.one.exchanges, 2U);
  EXPECT_EQ(diff.one.turns, 2U);
  EXPECT_EQ(diff.one.events, 1U);
  EXPECT_TRUE(diff.one.has_events);
  EXPECT_TRUE(diff.other.has_events);
  EXPECT_EQ(diff.other.turns, 1U);
  EXPECT_EQ(diff.other.torn_tail, std::nullopt);
  EXPECT_EQ(diff.same, 1U);
  EXPECT_FALSE(diff.equal());
}

TEST_F(DiffLimits, WhereOneEndsEarlierTheRestIsMissingOrAdded) {
  const MemoryTape shorter = MemoryTape().write(1, "a").read(2, "A");
  const MemoryTape longer = MemoryTape().write(1, "a").read(2, "A").write(3, "b").read(4, "B").write(5, "c");
  EXPECT_THAT(kinds(longer, shorter), ElementsAre("missing", "missing"));
  EXPECT_THAT(kinds(shorter, longer), ElementsAre("added", "added"));
  EXPECT_THAT(kinds(MemoryTape(), longer), ElementsAre("added", "added", "added"));
  EXPECT_THAT(kinds(longer, MemoryTape()), ElementsAre("missing", "missing", "missing"));
}

TEST_F(DiffLimits, ATapeThatChangedMeanwhileIsTold) {
  const TapePaths one = put("one", MemoryTape().write(1, "a").read(2, "A").write(3, "b"));
  const TapePaths other = put("other", MemoryTape().write(1, "x"));
  const auto found = diff_tapes(one, other, {});
  ASSERT_TRUE(found);
  ASSERT_GE(found->differences.size(), 2U);
  auto reader = DifferenceReader::open(one, literal_tape(dir / "none"), found->differences, {});
  EXPECT_EQ(reader.error().code, Errc::usage);
  EXPECT_FALSE(DifferenceReader::open(literal_tape(dir / "none"), other, found->differences, {}));
  for (const TapePaths& changed : {one, other}) {
    const Bytes before = test::read_file(changed.write);
    test::write_file(changed.write, {});
    reader = DifferenceReader::open(one, other, found->differences, {});
    ASSERT_TRUE(reader);
    Result<ShownDifference> shown = reader->next();
    for (std::size_t n = 1; shown && n < found->differences.size(); ++n) shown = reader->next();
    EXPECT_EQ(shown.error(), make_error(Errc::io, "a tape has changed while it was compared; compare again"));
    test::write_file(changed.write, before);
  }
}

TEST_F(TapeVerbs, AnEmptyPartOfASplitTapeIsNone) {
  const TapePaths tape = put("t", MemoryTape().read(0, "a").read(1'000, "b").read(5'000, "c"));
  const TapePaths to = literal_tape(dir / "p");
  std::uint64_t progress = 0;
  const auto parts = split_tape(tape, to,
                                {.at = SplitOptions::At::every,
                                 .span = Micros(1'000),
                                 .writer = {.sync = false},
                                 .progress = [&](std::uint64_t bytes) { progress = bytes; }});
  ASSERT_TRUE(parts);
  ASSERT_EQ(parts->size(), 3U);
  EXPECT_EQ((*parts)[1].from, tape_time_us(1'000));
  EXPECT_EQ((*parts)[2].from, tape_time_us(5'000));
  EXPECT_EQ((*parts)[2].to, tape_time_us(5'000));
  EXPECT_EQ((*parts)[2].blocks, 1U);
  EXPECT_EQ((*parts)[2].events, 0U);
  EXPECT_GT(progress, 3 * 13U);
  EXPECT_TRUE(ends(part_tape(to, 3)));
  kill(tape);
  const TapePaths of_killed = literal_tape(dir / "k");
  ASSERT_TRUE(
      split_tape(tape, of_killed,
                 {.at = SplitOptions::At::session, .span = {}, .writer = {.sync = false}, .progress = {}}));
  EXPECT_FALSE(ends(part_tape(of_killed, 1)));
  fs::remove(tape.events);
  const TapePaths of_bare = literal_tape(dir / "b");
  ASSERT_TRUE(
      split_tape(tape, of_bare,
                 {.at = SplitOptions::At::session, .span = {}, .writer = {.sync = false}, .progress = {}}));
  EXPECT_TRUE(ends(part_tape(of_bare, 1)));
}

// Without an events file nothing tells whether such a tape is whole: what is made of it does not say so
// either.
TEST_F(TapeVerbs, WhatIsMadeOfHalfATapeWithoutEventsHasNoEnd) {
  const TapePaths whole = put("w", MemoryTape().read(0, "a").write(10, "q").read(1'000, "b"));
  fs::remove(whole.events);
  const TapePaths torn = put("t", MemoryTape().read(0, "a").write(10, "q").read(1'000, "b"));
  fs::remove(torn.events);
  fs::resize_file(torn.write, fs::file_size(torn.write) - 1);
  const TapePaths missing = put("m", MemoryTape().read(0, "a").read(1'000, "b"));
  fs::remove(missing.events);
  fs::remove(missing.write);
  const TapePaths other = put("o", MemoryTape().read(0, "a"));
  int made = 0;
  const auto to = [&] { return literal_tape(dir / ("made" + std::to_string(++made))); };
  for (const TapePaths* tape : {&whole, &torn, &missing}) {
    const bool is_whole = tape == &whole;
    for (const TapeTime until : {TapeTime::max(), tape_time_us(500)}) {
      const auto cut = cut_tape(
          *tape, to(),
          {.range = TimeRange{{}, until}, .rebased = false, .writer = {.sync = false}, .progress = {}});
      ASSERT_TRUE(cut);
      EXPECT_EQ(ends(cut->paths), is_whole);
      EXPECT_EQ(cut->half.has_value(), !is_whole);
    }
    const TapePaths parts = to();
    const auto split = split_tape(
        *tape, parts,
        {.at = SplitOptions::At::every, .span = Micros(500), .writer = {.sync = false}, .progress = {}});
    ASSERT_TRUE(split);
    ASSERT_EQ(split->size(), 2U);
    EXPECT_EQ(ends(part_tape(parts, 1)), is_whole);
    EXPECT_EQ(ends(part_tape(parts, 2)), is_whole);
    EXPECT_EQ(split->front().half.has_value(), !is_whole);
    const auto merged =
        merge_tapes({other, *tape}, to(), {.offsets = {}, .writer = {.sync = false}, .progress = {}});
    ASSERT_TRUE(merged);
    EXPECT_EQ(ends(merged->paths), is_whole);
    EXPECT_EQ(merged->halves.empty(), is_whole);
  }
}

TEST_F(TapeVerbs, AnOpenAloneAndACloseAloneEndAnExchange) {
  const TapePaths opened = put("o", MemoryTape().open(0).write(1, "a").open(3).write(4, "b"));
  EXPECT_THAT(kept(opened, ExchangeRange{2, 2}), ElementsAre("w 4 b"));
  const TapePaths closed = put("c", MemoryTape().write(1, "a").close(3).write(4, "b"));
  EXPECT_THAT(kept(closed, ExchangeRange{2, 2}), ElementsAre("w 4 b"));
}

TEST_F(TapeVerbs, DamageAtTheBeginningOfATapeThatIsMergedIsItsError) {
  const TapePaths one = put("one", MemoryTape().read(10, "a"));
  const TapePaths two = put("two", MemoryTape().read(20, "b").read(30, "c"));
  Bytes bytes = test::read_file(two.read);
  bytes.at(13 + 4) = 0xff;
  test::write_file(two.read, bytes);
  test::write_file(two.events, test::bytes_of(encode(TapeHeader{.device = "d", .driver = "p"}) + "x\n"));
  for (const std::vector<Micros>& offsets : {std::vector{Micros(5)}, std::vector<Micros>{}}) {
    const TapePaths to = next_name();
    const auto done =
        merge_tapes({one, two}, to, {.offsets = offsets, .writer = {.sync = false}, .progress = {}});
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, Errc::damaged_tape);
    EXPECT_FALSE(fs::exists(to.read));
  }
}

TEST_F(TapeVerbs, WhatCannotGoTogetherIsAnErrorOfUse) {
  const TapePaths one = put("one", MemoryTape().read(10, "a"));
  const TapePaths copy = literal_tape(dir / "copy");
  fs::copy_file(one.read, copy.read);
  fs::copy_file(one.events, copy.events);
  EXPECT_EQ(grouped_tapes({one, one}).error().code, Errc::usage);
  EXPECT_EQ(grouped_tapes({one, copy}).error().code, Errc::usage);
  fs::remove(copy.events);
  EXPECT_TRUE(grouped_tapes({one, copy}));
}

TEST_F(RecoverLimits, OfLostBytesAHeaderIsTakenOff) {
  for (const auto& [torn, bytes] : {std::pair(12U, 12), std::pair(13U, 1), std::pair(11U, 11)}) {
    const TapePaths source = literal_tape(dir / ("torn" + std::to_string(torn)));
    Bytes file = test::block_bytes({{1, "a"}, {2, "abcdef"}});
    file.resize(13 + torn);
    test::write_file(source.read, file);
    ASSERT_TRUE(recover(source));
    EXPECT_THAT(test::lines_on(made),
                testing::Contains(HasSubstr("\"event\":\"gap\",\"bytes\":" + std::to_string(bytes) + ",")));
  }
}

TEST_F(RecoverLimits, OtherBlocksWithTheSameBytesAreALoss) {
  const TapePaths source = put("t", MemoryTape().read(1, "a").read(2, "bc"));
  test::write_file(source.read, test::block_bytes({{1, "abc"}}));
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses, ElementsAre("tr: of 2 blocks and 3 bytes, as the end tells, 1 and 3 are there"));
}

TEST_F(RecoverLimits, AnEndWithoutDigestsComparesNone) {
  const TapePaths source = literal_tape(dir / "t");
  test::write_file(source.read, test::block_bytes({{1, "abc"}}));
  test::write_file(source.write, {});
  const event::End end{PayloadTotals{1, 3, std::nullopt}, PayloadTotals{0, 0, std::nullopt}};
  test::write_file(source.events, test::bytes_of(encode(TapeHeader{.device = "d", .driver = "p"}) +
                                                 encode(tape_time_us(5), end)));
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->clean());
}

}  // namespace
}  // namespace porttape
