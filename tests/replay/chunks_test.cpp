// chunks=bytes and random: pieces that the driver reads one by one.

#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

ReplayConfig cut(Chunks chunks, std::uint32_t seed = 1) {
  ReplayConfig config;
  config.chunks = chunks;
  config.chunk_seed = seed;
  return config;
}

// A driver that reads at once whatever comes.
std::vector<std::string> pieces_of(const MemoryTape& tape, const ReplayConfig& config) {
  Rig rig(tape, config);
  rig.open();
  while (rig.delivered.size() < tape.all(RecordKind::read).size()) {
    if (rig.engine.holds_piece()) rig.engine.on_taken(rig.now());
    rig.wait(10);
  }
  std::vector<std::string> pieces;
  for (const auto& delivery : rig.deliveries) pieces.push_back(delivery.bytes);
  return pieces;
}

MemoryTape long_tape() {
  MemoryTape tape;
  for (int i = 0; i < 20; ++i) tape.read(i * 1000, std::string(100, static_cast<char>('a' + i)));
  return tape;
}

TEST(Chunks, OneByteAtATimeEachOnceTheOneBeforeIsRead) {
  Rig rig(MemoryTape().read(1000, "abc"), cut(Chunks::bytes));
  rig.open().until(1000);
  EXPECT_EQ(rig.read(), "a");
  EXPECT_TRUE(rig.engine.holds_piece());
  EXPECT_EQ(rig.wait(500).read(), "");
  rig.engine.on_taken(rig.now());
  EXPECT_EQ(rig.settle().read(), "b");
}

TEST(Chunks, ADriverThatDoesNotReadIsWaitedForALittle) {
  Rig rig(MemoryTape().read(1000, "abc"), cut(Chunks::bytes));
  rig.open().until(1'000'000);
  ASSERT_EQ(rig.deliveries.size(), 3U);
  EXPECT_EQ(rig.deliveries[1].us, 11'000) << "kLongestWait";
  EXPECT_EQ(rig.deliveries[2].us, 21'000);
  EXPECT_FALSE(rig.engine.holds_piece());
}

TEST(Chunks, NoneIsHeldLongerThanALimitAfterItWasDue) {
  Rig rig(MemoryTape().read(1000, std::string(500, 'x')), cut(Chunks::bytes));
  rig.open().until(101'000);
  EXPECT_EQ(rig.delivered.size(), 500U);
  EXPECT_EQ(rig.deliveries.back().us, 101'000);
  EXPECT_EQ(rig.deliveries.back().block_ends.size(), rig.deliveries.back().bytes.size()) << "still pieces";
}

TEST(Chunks, HoldingIsNoLateness) {
  Rig rig(MemoryTape().write(0, "q").read(1000, std::string(20, 'x')), cut(Chunks::bytes));
  rig.open().write("q").until(1'000'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->timer_late_max_us, 0);
  EXPECT_EQ(rig.report->chunks, "bytes");
}

TEST(Chunks, AFlushDropsThePiecesThatAreHeld) {
  Rig rig(MemoryTape().read(1000, "abc").read(9000, "d"), cut(Chunks::bytes));
  rig.open().until(1000);
  rig.engine.on_event(rig.now(), line::Flush{});
  EXPECT_EQ(rig.settle().until(20'000).read(), "ad");
}

TEST(Chunks, RandomCutsAreTheSeeds) {
  const MemoryTape tape = long_tape();
  const auto pieces = pieces_of(tape, cut(Chunks::random, 7));
  EXPECT_EQ(pieces_of(tape, cut(Chunks::random, 7)), pieces);
  EXPECT_NE(pieces_of(tape, cut(Chunks::random, 8)), pieces);
  std::size_t longest = 0;
  std::string all;
  for (const auto& piece : pieces) {
    longest = std::max(longest, piece.size());
    all += piece;
  }
  EXPECT_EQ(all, tape.all(RecordKind::read));
  EXPECT_GT(longest, 8U);
  EXPECT_GT(pieces.size(), 100U) << "and short ones";
}

TEST(Chunks, TheReportSaysHowToCutSoAgain) {
  Rig rig(MemoryTape().read(0, "abc"), cut(Chunks::random, 4'000'000'000));
  rig.open().wait(100'000).close();
  EXPECT_EQ(rig.report->chunks, "random:4000000000");
  EXPECT_NE(to_text(*rig.report).find("--chunks random:4000000000"), std::string::npos);
  EXPECT_NE(to_json(*rig.report).find(R"("chunks":"random:4000000000")"), std::string::npos);
}

}  // namespace
}  // namespace porttape::test
