// What the room keeps, tells and takes at most: at the limit, and one beyond.

#include <cerrno>
#include <csignal>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <sys/resource.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/block_file.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/layout.hpp"
#include "libport/tape/line_state.hpp"
#include "libport/tape/new_tape.hpp"
#include "libport/tape/tape_summary.hpp"
#include "libport/tape/tape_writer.hpp"
#include "libport/tape/turn_reader.hpp"
#include "tests/support/memory_tape.hpp"
#include "tests/support/taking_sink.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::Block;
using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;

const std::string kLimitsHeader = "{\"format\":\"porttape-events\",\"version\":1}\n";

TapeSummary summary_with(const std::string& events, const std::vector<Block>& read = {},
                         const std::vector<Block>& write = {}) {
  auto summary = summarize("t.log", {test::memory("t.logr", test::block_bytes(read)),
                                     test::memory("t.logw", test::block_bytes(write)),
                                     test::memory("t.loge", test::bytes_of(kLimitsHeader + events))});
  if (!summary) throw std::runtime_error(summary.error().message);
  return std::move(*summary);
}
std::string line_of(std::int64_t us, const Event& event) { return encode(tape_time_us(us), event); }

TEST(TapeSummaryLimits, OfEachKindTheFirst64AreKept) {
  std::string events;
  for (int i = 0; i < 65; ++i) {
    events += line_of(1, event::Mark{std::to_string(i)});
    events += line_of(1, event::Settings{Side::driver, {.baud = static_cast<unsigned>(i)}, {}});
    events += line_of(1, event::Modem{LineSignal::Name::dtr, i % 2 == 0, Side::driver});
    events += line_of(1, event::Gap{1, tape_time_us(i), "w"});
    events += line_of(1, event::Fault{{.kind = "kind" + std::to_string(i)}});
  }
  const EventsSummary found = summary_with(events).events;
  EXPECT_EQ(found.marks.size(), 64U);
  EXPECT_EQ(found.marks.back().text, "63");
  EXPECT_EQ(found.settings.size(), 64U);
  EXPECT_EQ(found.settings.back().what.line.baud, 63U);
  EXPECT_EQ(found.signals.size(), 64U);
  EXPECT_EQ(found.gaps.size(), 64U);
  EXPECT_EQ(to_us(found.gaps.back().from), 63);
  EXPECT_EQ(found.gap_bytes, 65U);
  EXPECT_EQ(found.faults.size(), 64U);
  EXPECT_EQ(found.fault_kinds.size(), 64U);
  EXPECT_EQ(found.kinds.size(), 5U);
  EXPECT_EQ(found.count<event::Mark>(), 65U);
  EXPECT_EQ(found.count<event::Open>(), 0U);
}

TEST(TapeSummaryLimits, FaultsAreCountedByTheirKindsAndPlansAreNone) {
  const EventsSummary found =
      summary_with(line_of(1, event::Fault{{.kind = "plan", .spec = "drop:p=1"}}) +
                   line_of(2, event::Fault{{.kind = "drop"}}) + line_of(3, event::Fault{{.kind = "drop"}}) +
                   line_of(4, event::Fault{{.kind = "more", .count = 7}}))
          .events;
  EXPECT_EQ(found.faults.size(), 4U);
  EXPECT_EQ(found.fault_kinds, (std::map<StrangerText, std::uint64_t>{{"drop", 2}, {"more", 7}}));
}

TEST(TapeSummaryLimits, OfTheSessionsTheFirst1000AreKeptAndAllCounted) {
  std::string events;
  for (int i = 0; i < 1001; ++i) events += line_of(2 * i, event::Open{}) + line_of(2 * i + 1, event::Close{});
  const TapeSummary found = summary_with(events);
  EXPECT_EQ(found.session_count, 1001U);
  EXPECT_EQ(found.sessions.size(), 1000U);
  EXPECT_EQ(found.sessions.back().opened, tape_time_us(1998));
}

TEST(TapeSummaryLimits, ASessionHasItsBytesAndItsLength) {
  const TapeSummary found =
      summary_with(line_of(10, event::Open{}) + line_of(30, event::Close{}) + line_of(40, event::Open{}),
                   {{5, "before"}, {20, "abc"}, {35, "between"}, {50, "x"}}, {{15, "ab"}, {45, "abcd"}});
  ASSERT_EQ(found.sessions.size(), 2U);
  EXPECT_EQ(found.sessions[0].closed, tape_time_us(30));
  EXPECT_EQ(found.sessions[0].duration, Micros(20));
  EXPECT_EQ(found.sessions[0].read_bytes, 3U);
  EXPECT_EQ(found.sessions[0].write_bytes, 2U);
  EXPECT_EQ(found.sessions[1].closed, std::nullopt);
  EXPECT_EQ(found.sessions[1].duration, Micros(10));
  EXPECT_EQ(found.sessions[1].read_bytes, 1U);
  EXPECT_EQ(found.sessions[1].write_bytes, 4U);
}

TEST(TapeSummaryLimits, ATapeWithoutOpensIsOneSessionIfItHasBytes) {
  EXPECT_EQ(summary_with("").session_count, 0U);
  EXPECT_EQ(summary_with("", {{5, ""}}).session_count, 0U);
  const TapeSummary found = summary_with("", {{5, "a"}}, {{7, "bc"}});
  EXPECT_EQ(found.session_count, 1U);
  EXPECT_EQ(found.sessions.at(0).opened, std::nullopt);
  EXPECT_EQ(found.sessions.at(0).duration, Micros(7));
  EXPECT_EQ(found.sessions.at(0).write_bytes, 2U);
}

TEST(TapeSummaryLimits, AnEmptyFileHasNeitherAFirstNorALastTime) {
  const TapeSummary found = summary_with("", {}, {{7, ""}});
  EXPECT_EQ(found.read.first, std::nullopt);
  EXPECT_EQ(found.read.last, std::nullopt);
  EXPECT_EQ(found.write.first, tape_time_us(7));
  EXPECT_EQ(found.write.last, tape_time_us(7));
  EXPECT_EQ(found.read.largest_block, 0U);
}

TEST(TapeSummaryLimits, ABlockInPiecesIsOne) {
  const std::string large(BlockFile::kBufferSize * 2 + 1, 'x');
  const TapeSummary found = summary_with("", {{5, large}, {6, "a"}});
  EXPECT_EQ(found.read.blocks, 2U);
  EXPECT_EQ(found.read.bytes, large.size() + 1);
  EXPECT_EQ(found.read.largest_block, large.size());
}

std::string detected(const Bytes& read, const Bytes& write = {}) {
  MemorySource r("r", read);
  MemorySource w("w", write);
  const auto layout = detect_layout(&r, &w);
  return layout ? std::string(to_string(*layout)) : layout.error().message;
}

TEST(LayoutLimits, ATornFirstBlockClaimsAtMost64MiBAndIsOfBefore2038) {
  constexpr std::uint64_t kMost = std::uint64_t{64} << 20U;
  const auto torn = [](std::uint64_t seconds, std::uint64_t length) {
    Bytes bytes = test::header_bytes(seconds, 0, length);
    test::append(bytes, "xy");
    return detected(bytes);
  };
  EXPECT_EQ(torn(1, kMost), "big-endian");
  EXPECT_EQ(torn(1, kMost + 1), "r is not a file of a tape: it does not begin with a block");
  EXPECT_EQ(torn(0x7fffffff, kMost), "big-endian");
  EXPECT_EQ(torn(0x80000000, kMost), "r is not a file of a tape: it does not begin with a block");
}

TEST(LayoutLimits, APartOfAHeaderTellsSomethingFromItsNinthByteOn) {
  const Bytes late = test::header_bytes(0x01000000, 5, 2);
  const auto first = [&](std::ptrdiff_t size) { return detected(Bytes(late.begin(), late.begin() + size)); };
  EXPECT_THAT(first(8), HasSubstr("is not a file of a tape"));
  EXPECT_EQ(first(9), "big-endian");
  const Bytes early = test::header_bytes(1, 0, 2);
  EXPECT_EQ(detected(Bytes(early.begin(), early.begin() + 1)), "big-endian");
}

TEST(LayoutLimits, FilesOfTwoLayoutsAreNamedInTheirOrder) {
  const std::vector<Block> blocks{{0x010203, "some data"}, {0x010204, "more"}};
  EXPECT_EQ(detected(test::block_bytes(blocks), test::block_bytes(blocks, true)),
            "r and w are in different layouts: they are not the files of one tape");
  EXPECT_EQ(detected(test::block_bytes(blocks, true), test::block_bytes(blocks)),
            "r and w are in different layouts: they are not the files of one tape");
}

// A file that says it has more than can be read of it, or fails.
class LyingSource final : public ByteSource {
 public:
  LyingSource(Bytes bytes, std::uint64_t size, bool size_fails = false, bool read_fails = false)
      : bytes_("l", std::move(bytes)), size_(size), size_fails_(size_fails), read_fails_(read_fails) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    if (read_fails_) return make_error(Errc::io, "no bytes");
    return bytes_.read_at(offset, into);
  }
  Result<std::uint64_t> size() override {
    if (size_fails_) return make_error(Errc::io, "no size");
    return size_;
  }
  [[nodiscard]] const std::string& name() const override { return bytes_.name(); }

 private:
  MemorySource bytes_;
  std::uint64_t size_;
  bool size_fails_;
  bool read_fails_;
};

TEST(LayoutLimits, AFileThatCannotBeReadIsItsError) {
  const Bytes good = test::block_bytes({{1, "a"}});
  MemorySource other("o", good);
  for (const bool first : {false, true}) {
    LyingSource no_size({}, 5, true);
    LyingSource no_bytes({}, 5, false, true);
    EXPECT_EQ(detect_layout(first ? static_cast<ByteSource*>(&no_size) : &other, first ? nullptr : &no_size)
                  .error()
                  .message,
              "no size");
    EXPECT_EQ(detect_layout(first ? static_cast<ByteSource*>(&no_bytes) : &other, first ? nullptr : &no_bytes)
                  .error()
                  .message,
              "no bytes");
  }
  LyingSource shrunk(good, 1000);
  EXPECT_EQ(*detect_layout(&shrunk, nullptr), Layout::big_endian);
}

TEST(LayoutLimits, ABlockThatDataAreFoundForWinsOverOneThatIsOnlyClaimed) {
  EXPECT_EQ(detected(test::block_bytes({{1, "a"}}, true), test::block_bytes({{2, "b"}}, true)),
            "native 64-bit");
  EXPECT_EQ(detected(test::block_bytes({{1, "a"}, {2, "b"}}), {}), "big-endian");
}

BlockFile::Step last_step(BlockFile& file) {
  BlockFile::Step step = file.next();
  while (step == BlockFile::Step::piece) step = file.next();
  return step;
}

TEST(BlockFileLimits, AFileThatBecomesShorterInABlockIsNoTornTail) {
  const Bytes whole = test::block_bytes({{1, "abc"}, {2, "def"}});
  for (const std::ptrdiff_t size : {27, 28, 29}) {
    BlockFile file(std::make_unique<LyingSource>(Bytes(whole.begin(), whole.begin() + size), whole.size()),
                   Layout::big_endian, BlockFile::Blocks::whole);
    EXPECT_EQ(last_step(file), BlockFile::Step::failed) << size;
    EXPECT_EQ(file.error(), make_error(Errc::io, "l became shorter while it was read"));
    file.read_on();
    EXPECT_EQ(file.next(), BlockFile::Step::failed) << "an error stays";
  }
  BlockFile in_pieces(std::make_unique<LyingSource>(Bytes(whole.begin(), whole.begin() + 28), whole.size()),
                      Layout::big_endian, BlockFile::Blocks::in_pieces);
  EXPECT_EQ(last_step(in_pieces), BlockFile::Step::failed);
}

TEST(BlockFileLimits, ASizeThatCannotBeToldIsItsError) {
  BlockFile file(std::make_unique<LyingSource>(test::block_bytes({{1, "abc"}}), 0, true), Layout::big_endian,
                 BlockFile::Blocks::whole);
  EXPECT_EQ(last_step(file), BlockFile::Step::failed);
  EXPECT_EQ(file.error().message, "no size");
}

TEST(BlockFileLimits, IsReadOnOnlyFromItsEnd) {
  BlockFile file(test::memory("t", test::block_bytes({{1, "abc"}, {2, "def"}})), Layout::big_endian,
                 BlockFile::Blocks::whole);
  ASSERT_EQ(file.next(), BlockFile::Step::piece);
  file.read_on();
  ASSERT_EQ(file.next(), BlockFile::Step::piece);
  EXPECT_EQ(as_text(file.piece().data), "def");
  EXPECT_EQ(file.next(), BlockFile::Step::end);
  EXPECT_EQ(file.torn_tail(), std::nullopt);
}

TEST(HeaderOfATape, IsNothingWhereThereIsNone) {
  const test::TempDir dir;
  const TapePaths paths = literal_tape(dir / "t");
  EXPECT_EQ(header_of(paths), std::nullopt);
  test::write_file(paths.events, test::bytes_of("x\n"));
  EXPECT_EQ(header_of(paths), std::nullopt);
  test::write_file(paths.events, test::bytes_of(kLimitsHeader));
  EXPECT_EQ(header_of(paths), (TapeHeader{.device = "", .driver = ""}));
}

// Keeps what is appended, call by call.
class NotedSink final : public test::TakingSink {
 public:
  explicit NotedSink(std::vector<std::size_t>& sizes) : sizes_(sizes) {}
  Appended append(ByteView head, ByteView body) override {
    sizes_.push_back(head.size() + body.size());
    return TakingSink::append(head, body);
  }

 private:
  std::vector<std::size_t>& sizes_;
};

class NewTapeLimits : public testing::Test {
 protected:
  NewTape begin() {
    auto tape = NewTape::on_sinks({std::make_unique<NotedSink>(reads), std::make_unique<NotedSink>(writes),
                                   std::make_unique<NotedSink>(lines)},
                                  {.device = "d", .driver = "p"});
    if (!tape) throw std::runtime_error(tape.error().message);
    return std::move(*tape);
  }
  static constexpr std::size_t kAtOnce = std::size_t{256} * 1024;

  std::vector<std::size_t> reads;
  std::vector<std::size_t> writes;
  std::vector<std::size_t> lines;
};

TEST_F(NewTapeLimits, Gathers256KiBAndWritesMoreAtOnce) {
  NewTape tape = begin();
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(1), Bytes(kAtOnce - kHeaderSize, Byte{1})));
  EXPECT_THAT(reads, ElementsAre()) << "as much as is gathered";
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(2), {}));
  EXPECT_THAT(reads, ElementsAre(kAtOnce));
  ASSERT_TRUE(
      tape.begin_block(Direction::write, tape_time_us(1), static_cast<std::uint32_t>(2 * kAtOnce - 1)));
  ASSERT_TRUE(tape.add(Bytes(kAtOnce, Byte{1})));
  EXPECT_THAT(writes, ElementsAre(kHeaderSize, kAtOnce));
  ASSERT_TRUE(tape.add(Bytes(kAtOnce - 1, Byte{1})));
  EXPECT_THAT(writes, ElementsAre(kHeaderSize, kAtOnce));
  ASSERT_TRUE(tape.finish(std::nullopt));
  EXPECT_THAT(reads, ElementsAre(kAtOnce, kHeaderSize));
  EXPECT_THAT(writes, ElementsAre(kHeaderSize, kAtOnce, kAtOnce - 1));
  EXPECT_EQ(lines.size(), 1U);
}

TEST_F(NewTapeLimits, ErrorsSayWhatIsWrong) {
  const auto error = [&](std::int64_t before, std::int64_t us) {
    NewTape tape = begin();
    EXPECT_TRUE(tape.event(tape_time_us(before), event::Open{}));
    EXPECT_TRUE(tape.event(tape_time_us(before), event::Open{})) << "the same time is none that goes back";
    return tape.event(tape_time_us(us), event::Open{}).error();
  };
  EXPECT_EQ(error(0, -1), make_error(Errc::usage, "a tape has no room for the time -1 us"));
  EXPECT_EQ(error(0, kMaxBlockTimeUs + 1),
            make_error(Errc::usage, "a tape has no room for the time 4294967296000000 us"));
  EXPECT_EQ(
      error(1'000'010, 9),
      make_error(Errc::usage, "the time goes back, from 1.000010 s to 0.000009 s, which a tape cannot hold"));
  NewTape tape = begin();
  EXPECT_TRUE(tape.event(tape_time_us(0), event::Open{}));
  EXPECT_TRUE(tape.event(tape_time_us(kMaxBlockTimeUs), event::Open{}));
  EXPECT_TRUE(tape.begin_block(Direction::read, tape_time_us(1), 3));
  EXPECT_EQ(tape.event(tape_time_us(kMaxBlockTimeUs), event::Close{}).error(),
            make_error(Errc::usage, "a block lacks 3 of its bytes"));
  EXPECT_EQ(tape.add(as_bytes("x")).error().message, "a block lacks 3 of its bytes") << "an error stays";
  NewTape more = begin();
  EXPECT_TRUE(more.begin_block(Direction::read, tape_time_us(1), 3));
  EXPECT_EQ(more.add(as_bytes("abcd")).error(),
            make_error(Errc::usage, "a block has more bytes than it was begun with"));
  NewTape done = begin();
  EXPECT_TRUE(done.finish(std::nullopt));
  EXPECT_EQ(done.finish(std::nullopt).error(), make_error(Errc::usage, "the tape is finished"));
}

TEST_F(NewTapeLimits, KnowsTheLatestTimeOfTheThree) {
  for (int latest = 0; latest < 3; ++latest) {
    NewTape tape = begin();
    EXPECT_EQ(tape.latest(), TapeTime{});
    EXPECT_TRUE(tape.block(Direction::read, tape_time_us(latest == 0 ? 9 : 1), as_bytes("a")));
    EXPECT_TRUE(tape.block(Direction::write, tape_time_us(latest == 1 ? 9 : 2), as_bytes("a")));
    EXPECT_TRUE(tape.event(tape_time_us(latest == 2 ? 9 : 3), event::Open{}));
    EXPECT_EQ(tape.latest(), tape_time_us(9));
  }
}

TEST(NewTapeOnADisk, HasItsEndBehindAllThatIsOnIt) {
  const test::TempDir dir;
  const auto end_of = [&](std::int64_t block_us, std::int64_t event_us, std::int64_t end_us) {
    const TapePaths paths = literal_tape(dir / "t");
    auto tape = NewTape::create(paths, TapeHeader{.device = "d", .driver = "p"},
                                {.on_existing = OnExisting::overwrite, .sync = false});
    EXPECT_TRUE(tape->event(tape_time_us(event_us), event::Open{}));
    EXPECT_TRUE(tape->block(Direction::write, tape_time_us(block_us), as_bytes("a")));
    EXPECT_EQ(*tape->finish(tape_time_us(end_us)), paths);
    const auto summary = summarize(paths);
    return summary ? to_us(*summary->events.last) : -1;
  };
  EXPECT_EQ(end_of(5, 0, 5), 6);
  EXPECT_EQ(end_of(5, 0, 9), 9);
  EXPECT_EQ(end_of(5, 8, 0), 8);
  EXPECT_EQ(end_of(kMaxBlockTimeUs, 0, 0), kMaxBlockTimeUs);
}

std::vector<std::string> reads_of_turns(const std::string& data) {
  const MemoryTape tape = MemoryTape().read(1, data);
  test::MemorySource source(tape);
  TurnReader reader(source);
  std::vector<std::string> all;
  for (;;) {
    const auto next = reader.next();
    if (!next || *next == nullptr) return all;
    all.emplace_back(as_text((**next).reads));
  }
}

TEST(TurnReaderLimits, ARunOf4096BytesIsNotCutAndALongerOneBehindALine) {
  std::string lines;
  while (lines.size() < 4096) lines += "0123456789abcde\n";
  EXPECT_THAT(reads_of_turns(lines), ElementsAre(lines));
  const std::string line(15, 'y');
  const std::string longer =
      std::string(4095, 'x') + "\n" + line + "\n" + line + "\n" + line.substr(1) + "\n.";
  const auto parts = reads_of_turns(longer);
  ASSERT_GE(parts.size(), 2U);
  EXPECT_EQ(parts[0], longer.substr(0, 4096 + 16)) << "the line's end at 4096 is within what is not cut";
  EXPECT_EQ(parts[1], line + "\n") << "as short as a part may be";
  EXPECT_EQ(parts[2], line.substr(1) + "\n.") << "a shorter one goes on";
}

TEST(TurnReaderLimits, APartHasAtMost4MiB) {
  const std::string same(std::size_t{9} << 20U, 'x');
  const auto parts = reads_of_turns(same);
  ASSERT_EQ(parts.size(), 3U);
  EXPECT_EQ(parts[0].size(), std::size_t{4} << 20U);
  EXPECT_EQ(parts[1].size(), std::size_t{4} << 20U);
}

TEST(TurnReaderLimits, ATurnIsGivenWithAtMost1024Events) {
  for (const std::size_t events : {1024U, 1025U}) {
    MemoryTape tape;
    tape.write(1, "a");
    for (std::size_t i = 0; i < events; ++i) tape.event(2, event::Mark{"m"});
    tape.read(3, "A");
    test::MemorySource source(tape);
    TurnReader reader(source);
    const auto first = reader.next();
    EXPECT_EQ(as_text((**first).reads), events == 1024 ? "A" : "");
  }
}

TEST(LineStateLimits, HoldsEachSidesSettingsAndEndAndSignalForItself) {
  LineState state;
  std::vector<std::string> lines;
  std::vector<Event> events{event::Settings{Side::device, {.baud = 1}, {}},
                            event::Settings{Side::driver, {.baud = 2}, {}},
                            event::Settings{{}, {.baud = 3}, {}},
                            event::HalfClose{Side::driver},
                            event::HalfClose{Side::device},
                            event::DeviceLost{.why = "x"},
                            event::Open{}};
  for (const Side by : {Side::driver, Side::device}) {
    for (const auto name :
         {LineSignal::Name::dtr, LineSignal::Name::rts, LineSignal::Name::cts, LineSignal::Name::dsr,
          LineSignal::Name::cd, LineSignal::Name::ri, LineSignal::Name::brk})
      events.push_back(signal_event({by, {name, true}}));
  }
  std::rotate(events.begin(), events.begin() + 6, events.begin() + 7);  // the open first
  const auto record_of = [&](const Event& event, const std::string& line) {
    Record record;
    record.event = &event;
    record.event_line = line;
    return record;
  };
  for (const Event& event : events) lines.push_back(encode(tape_time_us(5), event));
  for (std::string& line : lines) line.pop_back();
  for (std::size_t i = 0; i < events.size(); ++i) {
    EXPECT_FALSE(state.holds(record_of(events[i], lines[i]))) << lines[i];
    state.pass(record_of(events[i], lines[i]));
    EXPECT_TRUE(state.holds(record_of(events[i], lines[i]))) << lines[i];
    std::string later = encode(tape_time_us(9), events[i]);
    later.pop_back();
    EXPECT_TRUE(state.holds(record_of(events[i], later))) << "whenever it was told";
  }
  EXPECT_THAT(state.lines(), testing::UnorderedElementsAreArray(lines));
  EXPECT_EQ(state.lines().front(), lines.front());
  EXPECT_EQ(state.lines().back(), lines.back()) << "of a signal the device's comes behind the driver's";
  const Event changed = event::Settings{Side::device, {.baud = 7}, {}};
  EXPECT_FALSE(state.holds(record_of(changed, encode(tape_time_us(5), changed))));
  EXPECT_FALSE(state.holds(Record{}));
  state.pass(Record{});
  const Event mark = event::Mark{"m"};
  EXPECT_FALSE(state.holds(record_of(mark, encode(tape_time_us(5), mark))));
  const Event close = event::Close{};
  state.pass(record_of(close, encode(tape_time_us(5), close)));
  EXPECT_THAT(state.lines(), ElementsAre(lines[1], lines[3])) << "of the device, and of nobody named";
}

TEST(TapeSummaryLimits, AnEventsFileThatIsNoneIsItsDamageAlone) {
  const auto of = [](const std::string& events) {
    return summarize("t", {test::memory("tr", test::block_bytes({{1, "a"}})), nullptr,
                           test::memory("te", test::bytes_of(events))});
  };
  const auto damaged = of("x\n");
  ASSERT_TRUE(damaged);
  EXPECT_TRUE(damaged->events.exists);
  ASSERT_TRUE(damaged->events.damage);
  EXPECT_EQ(damaged->events.damage->code, Errc::damaged_tape);
  EXPECT_EQ(damaged->read.blocks, 1U);
  EXPECT_EQ(damaged->damages().size(), 1U);
  EXPECT_EQ(of("{\"format\":\"porttape-events\",\"version\":2}\n").error().code, Errc::not_a_tape);
}

std::vector<std::string> parts_of(const MemoryTape& tape) {
  test::MemorySource source(tape);
  TurnReader reader(source);
  std::vector<std::string> all;
  for (;;) {
    const auto next = reader.next();
    if (!next || *next == nullptr) return all;
    all.push_back(std::to_string((**next).writes.size()) + "/" + std::to_string((**next).reads.size()));
  }
}

TEST(TurnReaderLimits, EachDirectionOfAnExchangeIsARunOfItsOwn) {
  std::string lines;
  while (lines.size() < 3000) lines += "0123456789abcdefghi\n";
  EXPECT_THAT(parts_of(MemoryTape().write(1, lines).read(2, lines)), ElementsAre("3000/3000"));
  EXPECT_THAT(parts_of(MemoryTape().write(1, lines).read(2, lines).write(3, lines).read(4, lines)),
              ElementsAre("3000/3000", "3000/3000"));
  EXPECT_GT(parts_of(MemoryTape().write(1, lines).read(2, lines).read(3, lines)).size(), 2U);
  MemoryTape opened;
  opened.read(1, lines).open(2).read(3, lines);
  EXPECT_THAT(parts_of(opened), ElementsAre("0/3000", "0/3000"));
}

TEST_F(NewTapeLimits, AFileThatCannotBeWrittenIsNamed) {
  const test::TempDir dir;
  const TapePaths paths = literal_tape(dir / "t");
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  auto* const handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const auto& [kind, path] :
       {std::pair(0, paths.read), std::pair(1, paths.write), std::pair(2, paths.events)}) {
    auto tape = NewTape::create(paths, TapeHeader{.device = "d", .driver = "p"}, {.sync = false});
    ASSERT_TRUE(tape);
    if (kind < 2) {
      EXPECT_TRUE(
          tape->block(kind == 0 ? Direction::read : Direction::write, tape_time_us(1), as_bytes("a")));
    }
    const rlimit none{0, before.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &none);
    const auto finished = tape->finish(std::nullopt);
    ::setrlimit(RLIMIT_FSIZE, &before);
    EXPECT_EQ(finished.error(), make_error(Errc::io, "cannot write '" + path.string() + "': File too large"));
  }
  std::signal(SIGXFSZ, handler);
}

}  // namespace
}  // namespace porttape
