// Modem lines as a driver reads them.

#include "libport/supervise/line_model.hpp"

#include <sys/ioctl.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using Name = LineSignal::Name;

LineModel model_of(std::string_view lines) { return LineModel(*parse_line_defaults(lines)); }

TEST(LineModel, AnOpenRaisesWhatTheDriverDrives) {
  LineModel model;
  EXPECT_EQ(model.bits(), TIOCM_CTS | TIOCM_DSR | TIOCM_CD);
  model.opened();
  EXPECT_EQ(model.bits(), TIOCM_DTR | TIOCM_RTS | TIOCM_CTS | TIOCM_DSR | TIOCM_CD);
  model.closed();
  EXPECT_EQ(model.bits(), TIOCM_CTS | TIOCM_DSR | TIOCM_CD);
}

TEST(LineModel, OnlyAChangeIsOne) {
  LineModel model;
  EXPECT_TRUE(model.drive(Name::rts, true));
  EXPECT_FALSE(model.drive(Name::rts, true));
  EXPECT_TRUE(model.drive(Name::rts, false));
}

TEST(LineModel, LoopbackLeadsOutputsToInputs) {
  LineModel model = model_of("loopback");
  model.opened();
  EXPECT_EQ(model.bits(), TIOCM_DTR | TIOCM_RTS | TIOCM_CTS | TIOCM_DSR | TIOCM_CD);
  (void)model.drive(Name::rts, false);
  EXPECT_EQ(model.bits(), TIOCM_DTR | TIOCM_DSR | TIOCM_CD);
  EXPECT_EQ(model.counters().cts, 2);
}

TEST(LineModel, TheDevicesOwnLinesTakeThePlaceOfTheDefaults) {
  LineModel model = model_of("loopback");
  model.show({Name::cts, true});
  (void)model.drive(Name::rts, true);
  (void)model.drive(Name::rts, false);
  EXPECT_EQ(model.bits(), TIOCM_CTS);
}

TEST(LineModel, CountersCountChanges) {
  LineModel model;
  model.show({Name::cts, true});
  EXPECT_EQ(model.counters().cts, 0);
  model.show({Name::cts, false});
  model.show({Name::ri, true});
  EXPECT_EQ(model.counters().ri, 0);
  model.show({Name::ri, false});
  model.show({Name::brk, true});
  model.show({Name::brk, false});
  EXPECT_EQ(model.counters(), (LineModel::Counters{.cts = 1, .ri = 1, .breaks = 1}));
}

TEST(LineModel, LinesAreReadFromText) {
  EXPECT_EQ(*parse_line_defaults("on"), LineDefaults{});
  EXPECT_EQ(*parse_line_defaults("off"), (LineDefaults{.cts = false, .dsr = false, .cd = false}));
  EXPECT_EQ(*parse_line_defaults("cts=off,ri=on"), (LineDefaults{.cts = false, .ri = true}));
  for (const char* wrong : {"", "yes", "cts", "cts=", "cts=1", "rts=on", "cts=on,", "loopback,cts=on"}) {
    const auto parsed = parse_line_defaults(wrong);
    ASSERT_FALSE(parsed) << wrong;
    EXPECT_THAT(parsed.error().message, testing::HasSubstr("accepted: on, off, loopback"));
  }
}

}  // namespace
}  // namespace porttape
