// Events that wait until somebody can be told of them.

#include "libport/line/waiting_events.hpp"

#include <string>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using Name = LineSignal::Name;

// `s300` settings, `f0` a flush (and of which queue), `rts+` a signal, `d1` and `a1` requests.
std::string text_of(const std::vector<LineEvent>& events) {
  std::string text;
  for (const LineEvent& event : events) {
    text +=
        std::visit(
            LineVisitor{
                [](const line::Settings& each) { return "s" + std::to_string(each.seen.baud.value_or(0)); },
                [](const line::Flush& each) { return "f" + std::to_string(static_cast<int>(each.queue)); },
                [](const LineSignal& each) {
                  return std::string(name_of(each.name)) + (each.on ? "+" : "-");
                },
                [](const line::Drain& each) { return "d" + std::to_string(each.number); },
                [](const line::Ask& each) { return "a" + std::to_string(each.number); },
                [](const auto&) { return std::string("?"); },
            },
            event) +
        " ";
  }
  return text;
}

line::Settings baud(unsigned rate) { return {.seen = {.baud = rate}}; }

TEST(WaitingEventsTest, AreTakenInOrderAndOnce) {
  WaitingEvents waiting;
  waiting.put(LineSignal{Name::rts, true});
  waiting.put(line::Drain{1});
  waiting.put(line::Ask{2, {}});
  waiting.put(LineSignal{Name::rts, false});
  EXPECT_EQ(text_of(waiting.take_all()), "rts+ d1 a2 rts- ");
  EXPECT_EQ(text_of(waiting.take_all()), "");
}

TEST(WaitingEventsTest, SomeAreTakenAndTheOthersStayInOrder) {
  WaitingEvents waiting;
  waiting.put(line::Drain{1});
  waiting.put(baud(300));
  waiting.put(line::Drain{2});
  const auto is_drain = [](const LineEvent& event) { return std::holds_alternative<line::Drain>(event); };
  EXPECT_EQ(text_of(waiting.take([&](const LineEvent& event) { return !is_drain(event); })), "s300 ");
  waiting.put(line::Ask{3, {}});
  EXPECT_EQ(text_of(waiting.take_all()), "d1 d2 a3 ");
}

TEST(WaitingEventsTest, TheLastSettingsAreKept) {
  WaitingEvents waiting;
  waiting.put(baud(300));
  waiting.put(line::Flush{FlushQueue::in});
  waiting.put(baud(600));
  EXPECT_EQ(text_of(waiting.take_all()), "f0 s600 ");
}

TEST(WaitingEventsTest, FlushesAreKeptAsOne) {
  WaitingEvents waiting;
  waiting.put(line::Flush{FlushQueue::out});
  waiting.put(line::Flush{FlushQueue::out});
  EXPECT_EQ(text_of(waiting.take_all()), "f1 ");
  waiting.put(line::Flush{FlushQueue::in});
  waiting.put(line::Flush{FlushQueue::out});
  EXPECT_EQ(text_of(waiting.take_all()), "f2 ");
}

TEST(WaitingEventsTest, OfVeryManySignalsTheOlderChangesAreLeftOut) {
  WaitingEvents waiting;
  waiting.put(LineSignal{Name::brk, true});
  for (std::size_t n = 1; n < WaitingEvents::kMost; ++n) waiting.put(LineSignal{Name::rts, n % 2 == 0});
  EXPECT_EQ(waiting.take_all().size(), WaitingEvents::kMost);
  waiting.put(LineSignal{Name::brk, true});
  for (int n = 0; n < 100'000; ++n) waiting.put(LineSignal{Name::rts, n % 2 == 0});
  waiting.put(LineSignal{Name::dtr, false});
  const std::vector<LineEvent> kept = waiting.take_all();
  EXPECT_EQ(kept.size(), WaitingEvents::kMost + 1) << "there was no older change of dtr";
  EXPECT_EQ(text_of({kept.front()}), "break+ ");
  EXPECT_EQ(text_of({kept.end() - 2, kept.end()}), "rts- dtr- ");
}

TEST(WaitingEventsTest, OfVeryManyOfAnotherKindTheOlderOnesAreLeftOut) {
  WaitingEvents waiting;
  waiting.put(LineSignal{Name::rts, true});
  for (int n = 0; n < 10'000; ++n) waiting.put(line::Mark{std::to_string(n)});
  const std::vector<LineEvent> kept = waiting.take_all();
  ASSERT_EQ(kept.size(), WaitingEvents::kMost);
  EXPECT_EQ(text_of({kept.front()}), "rts+ ") << "it is of no kind that comes again";
  EXPECT_EQ(std::get<line::Mark>(kept[1]).text, std::to_string(10'001 - WaitingEvents::kMost));
  EXPECT_EQ(std::get<line::Mark>(kept.back()).text, "9999");
}

TEST(WaitingEventsTest, NoRequestIsLeftOut) {
  WaitingEvents waiting;
  for (RequestNumber n = 0; n < 2 * WaitingEvents::kMost; ++n) waiting.put(line::Drain{n});
  EXPECT_EQ(waiting.take_all().size(), 2 * WaitingEvents::kMost) << "who asked waits for each answer";
}

TEST(WaitingEventsTest, HowSignalsStandAtARequestIsKept) {
  WaitingEvents waiting;
  waiting.put(LineSignal{Name::rts, true});
  waiting.put(line::Ask{1, {}});
  for (int n = 0; n < 10'000; ++n) waiting.put(LineSignal{Name::rts, n % 2 == 0});
  const std::vector<LineEvent> kept = waiting.take_all();
  EXPECT_EQ(kept.size(), WaitingEvents::kMost + 2);
  EXPECT_EQ(text_of({kept.begin(), kept.begin() + 2}), "rts+ a1 ");
}

}  // namespace
}  // namespace porttape
