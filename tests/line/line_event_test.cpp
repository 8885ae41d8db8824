// What can happen on a line, and the requests that wait for their answers.

#include "libport/line/line_event.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/line/waiting_requests.hpp"

namespace porttape {
namespace {

TEST(LineEventTest, WhatADriverDoesToItsLineKeepsItsPlaceAmongTheBytes) {
  const std::vector<LineEvent> in_place = {line::Flush{}, line::Settings{}, LineSignal{}, line::Drain{},
                                           line::Ask{}};
  for (const LineEvent& event : in_place) EXPECT_TRUE(keeps_place(event)) << event.index();
}

TEST(LineEventTest, AnswersLossesAndFaultsAreToldAtOnce) {
  const std::vector<LineEvent> at_once = {line::Sent{},        line::Answer{},  line::LeftUnread{},
                                          line::Refused{},     line::Dropped{}, LineFault{},
                                          line::WatchSignals{}};
  for (const LineEvent& event : at_once) EXPECT_FALSE(keeps_place(event)) << event.index();
}

TEST(WaitingRequestsTest, EachIsAnsweredOnceByItsNumber) {
  WaitingRequests<std::string> waiting;
  const RequestNumber first = waiting.keep("first");
  const RequestNumber second = waiting.keep("second");
  EXPECT_NE(first, second);
  EXPECT_EQ(waiting.take(second), "second");
  EXPECT_EQ(waiting.take(second), std::nullopt) << "it was answered";
  EXPECT_EQ(waiting.take(first), "first");
  EXPECT_EQ(waiting.take(second + 1), std::nullopt) << "another's";
  EXPECT_EQ(waiting.keep("third"), second + 1) << "no number comes again";
}

}  // namespace
}  // namespace porttape
