#include "libport/catalog/channel.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/types.hpp"
#include "libport/tty/pty_port.hpp"
#include "libport/tty/serial_port.hpp"

namespace porttape {
namespace {

Result<ChannelPorts> ports_of(ChannelMode mode, std::map<std::string, std::string> values) {
  return channel_ports({mode, std::move(values)});
}

TEST(Channel, RecordingIsABridgeWhoseDevicePortLogs) {
  const auto ports =
      ports_of(ChannelMode::record,
               {{"device", "/dev/ttyUSB0,baud=115200"}, {"driver", "pty:/tmp/x"}, {"tape", "laser"}});
  ASSERT_TRUE(ports.has_value()) << ports.error().message;
  EXPECT_EQ(ports->device.type().name, "seriallog");
  const RecordingOptions& recording = *ports->device.get<RecordingOptions>();
  EXPECT_EQ(recording.tape.name(), "laser.log");
  EXPECT_EQ(recording.inner.get<SerialOptions>()->settings.baud, 115200U);
  EXPECT_EQ(ports->driver.get<PtyOptions>()->link, "/tmp/x");
}

TEST(Channel, AMissingOptionIsNamed) {
  const auto ports = ports_of(ChannelMode::record, {{"device", "/dev/ttyUSB0"}, {"driver", "pty"}});
  ASSERT_FALSE(ports.has_value());
  EXPECT_EQ(ports.error().code, Errc::usage);
  EXPECT_NE(ports.error().message.find("'tape'"), std::string::npos);
}

TEST(Channel, ABadPortNamesTheOptionAndWhatIsAccepted) {
  const auto ports =
      ports_of(ChannelMode::bridge, {{"device", "serial:/dev/ttyUSB0,parity=mark"}, {"driver", "pty"}});
  ASSERT_FALSE(ports.has_value());
  for (const char* part : {"'device'", "'parity'", "'mark'", "even"}) {
    EXPECT_NE(ports.error().message.find(part), std::string::npos) << part;
  }
}

TEST(Channel, ATapeThatIsNotThereIsAnError) {
  const auto ports = ports_of(ChannelMode::replay, {{"tape", "/nowhere/laser"}, {"driver", "pty"}});
  ASSERT_FALSE(ports.has_value());
  EXPECT_EQ(ports.error().code, Errc::usage);
}

TEST(Channel, APortWithATapeOfItsOwnIsNotRecordedAgain) {
  const auto ports = ports_of(ChannelMode::record,
                              {{"device", "type=tcplog,port=5,file=q"}, {"driver", "pty"}, {"tape", "q"}});
  ASSERT_FALSE(ports.has_value());
  EXPECT_NE(ports.error().message.find("type tcplog cannot be recorded"), std::string::npos)
      << ports.error().message;
}

TEST(Channel, OneRunOverDatagramsEndsWithTheTape) {
  const std::string tape = PORTTAPE_SAMPLE_DIR "/nmea.log";
  const auto at_end = [&](const std::string& driver, std::map<std::string, std::string> more) {
    more.insert({{"tape", tape}, {"driver", driver}});
    const auto ports = ports_of(ChannelMode::replay, std::move(more));
    EXPECT_TRUE(ports.has_value());
    return ports ? ports->device.get<ReplayOptions>()->config.at_end : AtEnd::hangup;
  };
  EXPECT_EQ(at_end("udp-listen:127.0.0.1:2000", {{"once", "1"}}), AtEnd::exit);
  EXPECT_EQ(at_end("udp-listen:127.0.0.1:2000", {{"once", "1"}, {"at-end", "idle"}}), AtEnd::idle);
  EXPECT_EQ(at_end("udp-listen:127.0.0.1:2000", {}), AtEnd::idle);
  EXPECT_EQ(at_end("pty", {{"once", "1"}}), AtEnd::idle);
}

TEST(Channel, ReplayHasTheVerbsDefaultsNotFlexiports) {
  const auto options = channel_options(ChannelMode::replay);
  const auto value = [&](std::string_view name) {
    return std::ranges::find(options, name, &OptionSpec::name)->default_value;
  };
  EXPECT_EQ(value("strictness"), "1");
  EXPECT_EQ(value("timing"), "reactive");
  EXPECT_EQ(port_types().find("logreader")->find("strictness")->default_value, "0");
  EXPECT_EQ(port_types().find("logreader")->find("timing")->default_value, "recorded");
}

}  // namespace
}  // namespace porttape
