#include "libport/tape/turn_reader.hpp"

#include <random>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/random_tape.hpp"

namespace porttape {
namespace {

using test::MemoryTape;
using testing::ElementsAre;

std::string describe_turn(const Turn& turn) {
  if (turn.is_event()) return std::string(name_of(turn.event)) + " " + std::to_string(turn.exchange);
  std::string text = turn.kind == Turn::Kind::exchange  ? "exchange "
                     : turn.kind == Turn::Kind::unasked ? "unasked "
                                                        : "part ";
  text += std::to_string(turn.exchange) + " " + std::string(as_text(turn.writes)) + ":" +
          std::string(as_text(turn.reads)) + " +" + std::to_string(turn.wait.count());
  if (turn.answer) text += " ?" + std::to_string(turn.answer->count());
  return text;
}

std::vector<Turn> turns_of(const MemoryTape& tape, std::size_t piece = 1U << 20U) {
  test::MemorySource source(tape, test::MemorySource::Select::merged, piece);
  TurnReader reader(source);
  std::vector<Turn> turns;
  for (;;) {
    const auto next = reader.next();
    if (!next || *next == nullptr) return turns;
    turns.push_back(**next);
  }
}

std::vector<std::string> texts_of(const MemoryTape& tape) {
  std::vector<std::string> texts;
  for (const Turn& turn : turns_of(tape)) texts.push_back(describe_turn(turn));
  return texts;
}

TEST(TurnReader, GivesExchangesWithTheirTimes) {
  EXPECT_THAT(
      texts_of(MemoryTape().write(100, "a").write(110, "b").read(150, "A").read(160, "B").write(200, "c")),
      ElementsAre("exchange 1 ab:AB +100 ?40", "exchange 2 c: +40"));
}

TEST(TurnReader, WhatNobodyAskedForIsATurnOfItsOwn) {
  EXPECT_THAT(
      texts_of(
          MemoryTape().read(10, "x").write(20, "a").read(25, "A").event(30, event::Mark{"m"}).read(40, "B")),
      ElementsAre("unasked 0 :x +10", "exchange 1 a:AB +10 ?5", "mark 1"));
}

TEST(TurnReader, EventsStandBehindTheirTurnAndAnEmptyReadAnswers) {
  EXPECT_THAT(texts_of(MemoryTape()
                           .event(0, event::Settings{})
                           .write(10, "a")
                           .event(11, event::Mark{"in between"})
                           .read(12, "")
                           .event(13, event::End{})
                           .write(20, "b")),
              ElementsAre("settings 0", "exchange 1 a: +10 ?2", "mark 1", "exchange 2 b: +8"));
}

TEST(TurnReader, OfAnyTapeNoByteIsLostAndLongRunsAreCutAlike) {
  std::mt19937 random(5);
  std::string data;
  while (data.size() < 200'000) {
    data += "$GPGGA," + std::to_string(random()) + "\r\n";
    for (auto i = random() % 30; i > 0; --i) data += static_cast<char>(random());
  }
  const std::string more = "something else\n";
  std::set<std::string> before;
  std::string all;
  const std::vector<Turn> turns = turns_of(MemoryTape().write(5, "go").read(10, data), 1000);
  EXPECT_GT(turns.size(), 1000U);
  for (const Turn& turn : turns) {
    EXPECT_EQ(turn.exchange, 1U);
    EXPECT_EQ(turn.part, static_cast<std::uint32_t>(&turn - turns.data()));
    before.insert(std::string(as_text(turn.reads)));
    all += as_text(turn.reads);
  }
  EXPECT_EQ(all, data);
  int fresh = 0;
  const std::string longer = data.substr(0, 90'000) + more + data.substr(90'000);
  for (const Turn& turn :
       turns_of(MemoryTape().write(5, "go").read(10, longer.substr(0, 777)).read(11, longer.substr(777))))
    fresh += before.contains(std::string(as_text(turn.reads))) ? 0 : 1;
  EXPECT_LE(fresh, 2);
}

TEST(TurnReader, TellsHowManyBytesOfTheFilesItHasRead) {
  const MemoryTape tape = MemoryTape().write(100, "ask").read(150, "answer");
  test::MemorySource source(tape, test::MemorySource::Select::merged, 4);
  std::vector<std::uint64_t> told;
  TurnReader reader(source, {.progress = [&told](std::uint64_t bytes) { told.push_back(bytes); }});
  ASSERT_TRUE(reader.next());
  EXPECT_THAT(told, ElementsAre(15, 31, 33)) << "each block has 12 bytes before its data";
}

TEST(TurnReader, CountsExchangesAndKeepsTheBytesOfRandomTapes) {
  std::mt19937 random(6);
  for (int round = 0; round < 300; ++round) {
    const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    const MemoryTape tape =
        test::random_tape(choose, {.sessions = true, .hang_ups = true, .half_closes = true, .gaps = true});
    std::string written;
    std::string read;
    for (const Turn& turn : turns_of(tape, 1 + choose(5))) {
      written += as_text(turn.writes);
      read += as_text(turn.reads);
    }
    EXPECT_EQ(written, tape.all(RecordKind::write));
    EXPECT_EQ(read, tape.all(RecordKind::read));
  }
}

}  // namespace
}  // namespace porttape
