#include "libport/replay/device_line.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

class DeviceLineTest : public testing::Test {
 public:
  DeviceLineTest& device(unsigned baud) { return tell(event::Settings{Side::device, {.baud = baud}, {}}); }
  DeviceLineTest& driver(unsigned baud) { return tell(event::Settings{Side::driver, {.baud = baud}, {}}); }
  DeviceLineTest& tell(const Event& event) {
    line.on_event(event, played);
    return *this;
  }
  [[nodiscard]] unsigned own() const { return line.own() ? *line.own()->baud : 0; }
  [[nodiscard]] unsigned taken_for(unsigned baud) const {
    const auto taken = line.taken_for({.baud = baud});
    return taken ? *taken->baud : 0;
  }

  DeviceLine line;
  bool played = true;
};

TEST_F(DeviceLineTest, ItsOwnIsWhatItHasWhenItComesUp) {
  EXPECT_EQ(own(), 0U);
  tell(event::Open{}).device(1200).driver(300).device(301);
  EXPECT_EQ(own(), 1200U);
}

TEST_F(DeviceLineTest, ItsOwnInALaterPartIsThatPartsOrTheLastBeforeIt) {
  played = false;
  tell(event::Open{}).device(1200).driver(300).tell(event::Close{});
  EXPECT_EQ(line.before().baud, 300U);
  played = true;
  tell(event::Open{});
  EXPECT_EQ(own(), 1200U);
  const DeviceLine kept = line;
  device(9600);
  EXPECT_EQ(own(), 9600U);
  line = kept;
  driver(300).device(301);
  EXPECT_EQ(own(), 1200U) << "the device's came as its answer to the driver";
}

TEST_F(DeviceLineTest, WhatItTookOtherwiseIsKnownByWhatWasAsked) {
  driver(300).tell(event::Flush{}).device(301).driver(600).driver(700).device(701);
  EXPECT_EQ(taken_for(300), 301U);
  EXPECT_EQ(taken_for(600), 0U) << "another was asked for before it answered";
  EXPECT_EQ(taken_for(700), 701U);
}

TEST_F(DeviceLineTest, WhatItHasAfterAReopenOrALossIsNoAnswer) {
  driver(300).tell(event::Close{}).tell(event::Open{}).device(9600);
  driver(600).tell(event::DeviceLost{}).tell(event::DeviceBack{}).device(9600);
  EXPECT_EQ(taken_for(300), 0U);
  EXPECT_EQ(taken_for(600), 0U);
}

TEST_F(DeviceLineTest, OneThatLiesWithoutEndTakesBoundedMemory) {
  for (unsigned baud = 1; baud <= 10'000; ++baud) driver(2 * baud).device(2 * baud + 1);
  EXPECT_EQ(taken_for(2), 3U);
  EXPECT_EQ(taken_for(20'000), 0U);
}

TEST_F(DeviceLineTest, SixtyFourAnswersAreKept) {
  for (unsigned baud = 1; baud <= 65; ++baud) driver(1000 + baud).device(2000 + baud);
  EXPECT_EQ(taken_for(1064), 2064U);
  EXPECT_EQ(taken_for(1065), 0U);
}

TEST_F(DeviceLineTest, DrainsAreOfWhatIsPlayedAndTheFirstOfVeryMany) {
  played = false;
  tell(event::Drain{.took = Micros{1}});
  EXPECT_TRUE(line.drains().empty());
  played = true;
  for (int i = 0; i < 65'536; ++i) tell(event::Drain{.took = Micros{2}});
  tell(event::Drain{.took = Micros{3}});
  EXPECT_EQ(line.drains().size(), 65'536U);
  EXPECT_EQ(line.drains().back(), Micros{2});
}

TEST_F(DeviceLineTest, MarksDrainsAndSignalsComeBetweenAQuestionAndItsAnswer) {
  driver(300).tell(event::Mark{}).tell(event::Drain{}).device(301);
  EXPECT_EQ(taken_for(300), 301U);
  driver(600).tell(event::Modem{.line = LineSignal::Name::dtr, .on = true, .by = Side::driver}).device(601);
  EXPECT_EQ(taken_for(600), 601U);
}

}  // namespace
}  // namespace porttape
