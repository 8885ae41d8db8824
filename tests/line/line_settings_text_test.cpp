#include "libport/line/line_settings_text.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

TEST(LineSettingsText, SaysWhatIsKnown) {
  EXPECT_EQ(to_text(SeenSettings::of({})), "9600 baud, 8N1");
  EXPECT_EQ(to_text(SeenSettings::of({115200, 7, Parity::even, 2, true, true})),
            "115200 baud, 7E2, RTS/CTS, XON/XOFF");
  EXPECT_EQ(to_text({.baud = 250000, .stop_bits = 1, .hw_flow = false}), "250000 baud, 1 stop bit");
  EXPECT_EQ(to_text({.data_bits = 5, .parity = Parity::mark, .hw_flow = true}),
            "5 data bits, parity mark, RTS/CTS");
  EXPECT_EQ(to_text({.baud = 0, .stop_bits = 2}), "hung up (B0), 2 stop bits");
  EXPECT_EQ(to_text(SeenSettings{}), "nothing is known of them");
}

TEST(LineSettingsText, InJsonWhatIsNotKnownIsAbsent) {
  JsonObject all;
  add_settings(all, SeenSettings::of({300, 7, Parity::space, 2, true, false}));
  EXPECT_EQ(all.str(), R"({"baud":300,"databits":7,"parity":"space","stopbits":2,)"
                       R"("hwflowctrl":true,"swflowctrl":false})");
  JsonObject some;
  add_settings(some, {.baud = 300});
  EXPECT_EQ(some.str(), R"({"baud":300})");
}

TEST(SeenSettings, OverOthersTakesOfThemWhatIsNotKnown) {
  const SeenSettings seen{.baud = 300, .hw_flow = true};
  const SeenSettings other{.baud = 9600, .parity = Parity::odd};
  EXPECT_EQ(seen.over(other), (SeenSettings{.baud = 300, .parity = Parity::odd, .hw_flow = true}));
}

}  // namespace
}  // namespace porttape
