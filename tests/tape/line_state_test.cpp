#include "libport/tape/line_state.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class LineStateTest : public testing::Test {
 protected:
  void pass(RecordKind kind, const Event& event) {
    std::string line = encode(tape_time_us(1), event);
    line.pop_back();
    Record record;
    record.kind = kind;
    record.event = &event;
    record.event_line = line;
    state.pass(record);
  }
  void signal(Side by, LineSignal::Name name, bool on) {
    pass(RecordKind::event, signal_event({by, {name, on}}));
  }
  [[nodiscard]] std::vector<std::string> held() const {
    std::vector<std::string> names;
    for (const std::string& line : state.lines()) {
      const TapeEvent event = *decode_event(line);
      const auto* settings = std::get_if<event::Settings>(&event.what);
      const auto signal = signal_of(event.what);
      std::string text(name_of(event.what));
      if (settings != nullptr) text += " " + std::to_string(settings->line.baud.value_or(0));
      if (signal) text += signal->signal.on ? " on" : " off";
      names.push_back(text);
    }
    return names;
  }
  LineState state;
};

TEST_F(LineStateTest, HoldsTheLastOfEachUntilTheCloseAndTheDevicesSettingsBeyond) {
  EXPECT_THAT(held(), IsEmpty());
  pass(RecordKind::event, event::Settings{Side::device, {.baud = 9600}, {}});
  pass(RecordKind::open, event::Open{});
  pass(RecordKind::event, event::Settings{Side::driver, {.baud = 300}, {}});
  pass(RecordKind::event, event::Settings{Side::driver, {.baud = 1200}, {}});
  signal(Side::device, LineSignal::Name::cts, true);
  signal(Side::device, LineSignal::Name::cts, false);
  pass(RecordKind::event, event::Mark{"no state"});
  EXPECT_THAT(held(), ElementsAre("open", "settings 9600", "settings 1200", "modem off"));
  pass(RecordKind::close, event::Close{});
  EXPECT_THAT(held(), ElementsAre("settings 9600"));
}

TEST_F(LineStateTest, ABreakHoldsUntilItEnds) {
  signal(Side::driver, LineSignal::Name::brk, true);
  EXPECT_THAT(held(), ElementsAre("break on"));
  signal(Side::driver, LineSignal::Name::brk, false);
  EXPECT_THAT(held(), IsEmpty());
}

TEST_F(LineStateTest, ALostDeviceAndWhoSentItsLastByte) {
  pass(RecordKind::open, event::Open{});
  pass(RecordKind::half_close, event::HalfClose{Side::driver});
  pass(RecordKind::event, event::DeviceLost{.why = "unplugged"});
  EXPECT_THAT(held(), ElementsAre("open", "device-lost", "half-close"));
  pass(RecordKind::event, event::DeviceBack{});
  EXPECT_THAT(held(), ElementsAre("open", "half-close"));
  pass(RecordKind::open, event::Open{});
  EXPECT_THAT(held(), ElementsAre("open"));
}

}  // namespace
}  // namespace porttape
