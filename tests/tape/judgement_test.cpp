#include "libport/tape/judgement.hpp"

#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
#include "libport/tape/payload_totals.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using BlockList = std::vector<Block>;
using Verdict = Judgement::Verdict;

const BlockList kAnswers{{2, "answer"}, {4, "bye"}};
const BlockList kQuestions{{1, "ask"}, {3, "end"}};

const std::string kTapeHeader = encode(TapeHeader{.device = "device", .driver = "driver", .id = "0123"});

PayloadTotals totals(const BlockList& blocks) {
  PayloadCounter counter;
  for (const Block& block : blocks) {
    counter.begin_block(tape_time_us(block.us), static_cast<std::uint32_t>(block.data.size()));
    counter.add(as_bytes(block.data));
  }
  return counter.totals();
}

// The three files of a tape called t.log; nothing is a file that is not there.
struct Files {
  std::optional<Bytes> read;
  std::optional<Bytes> write;
  std::optional<std::string> events;
};

Files recorded(const BlockList& read = kAnswers, const BlockList& write = kQuestions,
               const std::string& events = "") {
  const std::string lines = kTapeHeader + events;
  const event::End end{totals(read), totals(write), digest_of(as_bytes(lines))};
  return {test::block_bytes(read), test::block_bytes(write), lines + encode(tape_time_us(9), end)};
}

Judgement judged(const Files& files, bool being_written = false) {
  TapeSources sources;
  if (files.read) sources.read = test::memory("t.logr", *files.read);
  if (files.write) sources.write = test::memory("t.logw", *files.write);
  if (files.events) sources.events = test::memory("t.loge", test::bytes_of(*files.events));
  auto summary = summarize("t.log", std::move(sources));
  if (!summary) throw std::runtime_error(summary.error().message);
  summary->being_written = being_written;
  return judge(*summary);
}

TEST(Judgement, AWholeTapeIsSound) {
  for (const Files& files : {recorded(), recorded({}, kQuestions), recorded({}, {})}) {
    const Judgement judgement = judged(files);
    EXPECT_EQ(judgement.verdict, Verdict::sound);
    EXPECT_TRUE(judgement.sound());
    EXPECT_THAT(judgement.damages, IsEmpty());
    EXPECT_THAT(judgement.notes, IsEmpty());
  }
}

TEST(Judgement, AMissingFileIsNamed) {
  Files files = recorded();
  files.read.reset();
  EXPECT_THAT(judged(files).damages, ElementsAre("t.logr is missing: t.loge tells of 2 blocks, 9 bytes"));
  files = recorded();
  files.write.reset();
  EXPECT_THAT(judged(files).damages, ElementsAre("t.logw is missing: t.loge tells of 2 blocks, 6 bytes"));
}

TEST(Judgement, AMissingFileThatHeldNothingIsANote) {
  Files files = recorded(kAnswers, {});
  files.write.reset();
  const Judgement judgement = judged(files);
  EXPECT_EQ(judgement.verdict, Verdict::sound);
  EXPECT_THAT(judgement.notes, ElementsAre("t.logw is missing; it held nothing"));
}

TEST(Judgement, SwappedFilesAreNamed) {
  Files files = recorded();
  std::swap(files.read, files.write);
  const Judgement judgement = judged(files);
  EXPECT_EQ(judgement.verdict, Verdict::damaged);
  EXPECT_THAT(judgement.damages,
              ElementsAre("t.logr and t.logw are swapped: each holds what t.loge tells of the other"));
}

TEST(Judgement, AFileInTheOthersPlaceIsNamed) {
  Files files = recorded();
  files.read = files.write;
  EXPECT_THAT(
      judged(files).damages,
      ElementsAre("t.logr is what belongs in t.logw: it holds 2 blocks, 6 bytes; t.loge tells of 2 blocks, 9 "
                  "bytes"));
}

TEST(Judgement, AShortenedFileIsNamedWhereverItIsCut) {
  const Files whole = recorded();
  for (std::size_t size = 0; size < whole.read->size(); ++size) {
    Files files = whole;
    files.read->resize(size);
    const Judgement judgement = judged(files);
    EXPECT_EQ(judgement.verdict, Verdict::damaged) << size;
    EXPECT_THAT(judgement.damages, ElementsAre(HasSubstr("t.logr is shortened"))) << size;
  }
  for (std::size_t size = 0; size < whole.events->size(); ++size) {
    Files files = whole;
    files.events->resize(size);
    const Judgement judgement = judged(files);
    EXPECT_EQ(judgement.verdict, Verdict::flawed) << size;
    EXPECT_THAT(judgement.notes, testing::Contains(HasSubstr("t.loge has no end"))) << size;
  }
}

TEST(Judgement, AnotherTapesFileIsNamed) {
  Files files = recorded();
  files.read = test::block_bytes({{2, "answer"}, {4, "BYE"}});
  EXPECT_THAT(judged(files).damages,
              ElementsAre(testing::MatchesRegex(
                  "t.logr is another tape's, or changed: it holds 2 blocks, 9 bytes, xxh3 "
                  "[0-9a-f]{16}; t.loge tells of 2 blocks, 9 bytes, xxh3 [0-9a-f]{16}")));
  files = recorded();
  files.write = test::block_bytes({{1, "ask"}, {2, "and"}, {3, "end"}});
  EXPECT_THAT(judged(files).damages,
              ElementsAre("t.logw is another tape's, or changed: it holds 3 blocks, 9 bytes; "
                          "t.loge tells of 2 blocks, 6 bytes"));
  files = recorded();
  files.events = recorded({{5, "something"}}, {{6, "else"}}).events;
  EXPECT_THAT(judged(files).damages,
              ElementsAre(HasSubstr("t.logr is"), HasSubstr("t.logw is"),
                          "t.loge may be another tape's itself: nothing beside it is what it tells of"));
}

TEST(Judgement, OtherBlocksWithTheSameBytesAreSeen) {
  Files files = recorded();
  files.read = test::block_bytes({{2, "answerbye"}});
  EXPECT_EQ(judged(files).verdict, Verdict::damaged);
}

TEST(Judgement, ATapeThatNeverEndedIsNotSound) {
  Files files = recorded();
  files.events = kTapeHeader + encode(tape_time_us(0), event::Open{});
  const Judgement judgement = judged(files);
  EXPECT_EQ(judgement.verdict, Verdict::flawed);
  EXPECT_FALSE(judgement.sound());
  EXPECT_THAT(judgement.notes,
              ElementsAre("t.loge has no end: its recorder was killed, or it is shortened; a missing, "
                          "swapped, shortened or foreign file would not be seen"));
  files.write.reset();
  EXPECT_THAT(judged(files).notes, testing::Contains("t.logw is missing; what it held is not known"));
}

TEST(Judgement, AGapIsToldAndIsNotSound) {
  const Judgement judgement =
      judged(recorded(kAnswers, kQuestions,
                      encode(tape_time_us(3), event::Gap{512, tape_time_us(2), "disk full\x1b"}) +
                          encode(tape_time_us(4), event::Gap{0, tape_time_us(4), ""})));
  EXPECT_EQ(judgement.verdict, Verdict::flawed);
  EXPECT_THAT(
      judgement.notes,
      ElementsAre("t.loge: a gap from 0.000002 s to 0.000003 s, 512 bytes: disk full\\x1b",
                  "t.loge: a gap from 0.000004 s to 0.000004 s, events or an unknown number of bytes"));
}

TEST(Judgement, ManyGapsAreCounted) {
  std::string gaps;
  for (int i = 0; i < 70; ++i) gaps += encode(tape_time_us(3), event::Gap{1, tape_time_us(2), "disk full"});
  const Judgement judgement = judged(recorded(kAnswers, kQuestions, gaps));
  EXPECT_EQ(judgement.notes.size(), 65U);
  EXPECT_EQ(judgement.notes.back(), "t.loge: 6 more gaps");
}

TEST(Judgement, ATornTailIsANoteAndNotSound) {
  Files files = recorded();
  test::append(*files.read, "\1\2");
  const Judgement judgement = judged(files);
  EXPECT_EQ(judgement.verdict, Verdict::flawed);
  EXPECT_THAT(judgement.notes, ElementsAre(HasSubstr("t.logr: torn tail")));
}

TEST(Judgement, ATapeBeingWrittenIsNotSoundAndNotCompared) {
  Files files = recorded();
  files.read->resize(20);
  const Judgement judgement = judged(files, true);
  EXPECT_EQ(judgement.verdict, Verdict::flawed);
  EXPECT_THAT(judgement.notes, testing::Contains(HasSubstr("it is being written")));
}

TEST(Judgement, WithoutDigestsItSaysWhatCouldNotBeChecked) {
  Files files = recorded();
  files.events.reset();
  EXPECT_EQ(judged(files).verdict, Verdict::unchecked);
  const std::string uncovered = "times and events are not covered: ";
  EXPECT_THAT(judged(files).notes,
              ElementsAre(HasSubstr("no events file, so no digests: "), HasSubstr(uncovered)));
  for (const std::string& end : {encode(tape_time_us(9), event::End{}),
                                 encode(tape_time_us(9), event::End{PayloadTotals{2, 9, std::nullopt},
                                                                    PayloadTotals{2, 6, std::nullopt}})}) {
    files.events = kTapeHeader + end;
    EXPECT_EQ(judged(files).verdict, Verdict::unchecked);
  }
  EXPECT_THAT(judged(files).notes,
              ElementsAre("no digests in t.loge: changed bytes, or another tape's of the same "
                          "length, would not be seen",
                          HasSubstr(uncovered)));
  files.events = encode(TapeHeader{.device = "device", .driver = "driver"}) +
                 encode(tape_time_us(9), event::End{totals(kAnswers), totals(kQuestions)});
  EXPECT_EQ(judged(files).verdict, Verdict::unchecked);
  EXPECT_THAT(judged(files).notes,
              ElementsAre(HasSubstr("no id in t.loge, so no digests are compared"), HasSubstr(uncovered)));
  EXPECT_EQ(words_of(Verdict::unchecked).find("sound"), std::string_view::npos);
}

TEST(Judgement, ASwapOfEqualFilesCannotBeSeenAndIsTold) {
  const BlockList echo{{2, "hello"}};
  const Judgement judgement = judged(recorded(echo, echo));
  EXPECT_EQ(judgement.verdict, Verdict::unchecked);
  EXPECT_THAT(judgement.notes,
              ElementsAre("t.logr and t.logw hold the same bytes: a swap would not be seen"));
  EXPECT_EQ(judged(recorded({{2, "hel"}, {3, "lo"}}, echo)).verdict, Verdict::sound);
  EXPECT_EQ(judged(recorded(echo, {{1, "hello"}})).verdict, Verdict::sound) << "the times tell them apart";
}

TEST(Judgement, DamageIsNotToldTwice) {
  Files files = recorded();
  files.read = test::block_bytes({{4, "answer"}, {2, "bye"}});
  EXPECT_THAT(judged(files).damages,
              ElementsAre(HasSubstr("t.logr is damaged at offset 18: time goes back")));
  files.events.reset();
  EXPECT_THAT(judged(files).notes, IsEmpty()) << "what could not be checked does not matter any more";
}

TEST(Judgement, ADigestThatOneFileLacksIsTold) {
  Files files = recorded();
  for (const bool of_read : {false, true}) {
    PayloadTotals read = totals(kAnswers);
    PayloadTotals write = totals(kQuestions);
    (of_read ? read : write).xxh3.reset();
    files.events = kTapeHeader + encode(tape_time_us(9), event::End{read, write});
    EXPECT_EQ(judged(files).verdict, Verdict::unchecked);
    EXPECT_THAT(judged(files).notes, ElementsAre(HasSubstr("no digests in t.loge: changed bytes"),
                                                 HasSubstr("times and events are not covered")));
  }
}

TEST(Judgement, EachVerdictHasItsWords) {
  EXPECT_EQ(words_of(Verdict::sound), "sound");
  EXPECT_EQ(words_of(Verdict::unchecked), "no damage found, as far as it can be checked");
  EXPECT_EQ(words_of(Verdict::flawed), "no damage found");
  EXPECT_EQ(words_of(Verdict::damaged), "damaged");
  EXPECT_EQ(to_string(Verdict::sound), "sound");
  EXPECT_EQ(to_string(Verdict::unchecked), "unchecked");
  EXPECT_EQ(to_string(Verdict::flawed), "no-damage-found");
  EXPECT_EQ(to_string(Verdict::damaged), "damaged");
}

TEST(Judgement, AGapIsToldInSeconds) {
  Files files = recorded();
  const std::string gap =
      kTapeHeader + encode(tape_time_us(2'000'001), event::Gap{1, tape_time_us(1'500'000), ""});
  const event::End end{totals(kAnswers), totals(kQuestions), digest_of(as_bytes(gap))};
  files.events = gap + encode(tape_time_us(3'000'000), end);
  EXPECT_THAT(judged(files).notes, ElementsAre("t.loge: a gap from 1.500000 s to 2.000001 s, 1 byte"));
}

// A small tape with what a tape may have.
Files with_all_kinds() {
  std::string events;
  for (const Event& event : std::vector<Event>{
           event::Open{},
           event::Settings{Side::driver, {.baud = 9600U, .hw_flow = true}, SettingsOrder::exact},
           event::Modem{LineSignal::Name::cts, true, Side::device}, event::Break{true, Side::driver},
           event::Drain{Micros{7}}, event::Flush{FlushQueue::in}, event::Mark{"a mark"},
           event::HalfClose{Side::driver}, event::Fault{{.kind = "drop", .spec = "drop:byte=1"}},
           event::DeviceLost{"unplugged", true}, event::DeviceBack{}, event::Unknown{"later"},
           event::Close{}}) {
    events += encode(tape_time_us(5), event);
  }
  return recorded(kAnswers, kQuestions, events);
}

// As `porttape verify` finds it: damaged, or no tape.
bool is_refused(const Files& files) {
  try {
    return judged(files).verdict == Verdict::damaged;
  } catch (const std::runtime_error&) {
    return true;
  }
}

TEST(Judgement, OneBitChangedAnywhereIsDamage) {
  const Files whole = with_all_kinds();
  ASSERT_EQ(judged(whole).verdict, Verdict::sound);
  const auto try_each_bit = [](std::string_view file, auto& bytes, const auto& refused) {
    for (std::size_t at = 0; at < bytes.size(); ++at) {
      for (unsigned bit = 0; bit < 8; ++bit) {
        const auto was = bytes[at];
        bytes[at] = static_cast<std::decay_t<decltype(was)>>(static_cast<unsigned>(was) ^ (1U << bit));
        EXPECT_TRUE(refused()) << file << " byte " << at << " bit " << bit;
        bytes[at] = was;
      }
    }
  };
  Files files = whole;
  const auto refused = [&files] { return is_refused(files); };
  try_each_bit("r", *files.read, refused);
  try_each_bit("w", *files.write, refused);
  try_each_bit("e", *files.events, refused);
}

TEST(Judgement, ALineThatIsLostChangedOrAddedIsDamage) {
  const Files whole = with_all_kinds();
  std::vector<std::string> lines;
  for (std::size_t at = 0; at < whole.events->size();) {
    const std::size_t end = whole.events->find('\n', at) + 1;
    lines.push_back(whole.events->substr(at, end - at));
    at = end;
  }
  for (std::size_t lost = 1; lost + 1 < lines.size(); ++lost) {
    Files files = whole;
    files.events->clear();
    for (std::size_t i = 0; i < lines.size(); ++i) {
      if (i != lost) *files.events += lines[i];
    }
    const Judgement judgement = judged(files);
    EXPECT_EQ(judgement.verdict, Verdict::damaged) << lines[lost];
    EXPECT_THAT(
        judgement.damages,
        ElementsAre(testing::MatchesRegex(
            "t.loge is damaged in line 14: the lines before it are not those that were written: their "
            "xxh3 is [0-9a-f]{16}, and this line tells of [0-9a-f]{16}")));
  }
}

TEST(Judgement, AnOlderTapeSaysWhatIsNotCovered) {
  Files files = recorded();
  PayloadTotals read = totals(kAnswers);
  PayloadTotals write = totals(kQuestions);
  const auto judged_with = [&](const event::End& end) {
    files.events = kTapeHeader + encode(tape_time_us(9), end);
    return judged(files);
  };
  const auto lines = digest_of(as_bytes(kTapeHeader));
  EXPECT_THAT(judged_with({read, write, lines}).notes, IsEmpty());
  const std::string note =
      "times and events are not covered: t.loge has no digests of them, so a changed one would not be seen";
  EXPECT_THAT(judged_with({read, write, {}}).notes, ElementsAre(note));
  read.xxh3_all.reset();
  EXPECT_THAT(judged_with({read, write, lines}).notes, ElementsAre(note));
  read = totals(kAnswers);
  write.xxh3_all.reset();
  EXPECT_THAT(judged_with({read, write, lines}).notes, ElementsAre(note));
  EXPECT_EQ(judged_with({read, write, lines}).verdict, Verdict::sound);
}

}  // namespace
}  // namespace porttape
