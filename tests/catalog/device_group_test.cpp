#include "libport/catalog/device_group.hpp"

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "libport/catalog/channel.hpp"
#include "libport/tape/tape_writer.hpp"
#include "libport/taped/types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using Values = std::map<std::string, std::string>;

class DeviceGroupTest : public testing::Test {
 protected:
  static constexpr const char* kDriver = "tcp-listen:127.0.0.1:0";

  std::string error_of(ChannelMode mode, Values values) {
    const Result<ChannelPorts> ports = channel_ports({mode, std::move(values)});
    return ports ? "" : ports.error().message;
  }
  std::unique_ptr<DeviceGroup> make(ChannelMode mode, Values values) {
    values.emplace("driver", kDriver);
    values.emplace("connections", "each");
    const Result<ChannelPorts> ports = channel_ports({mode, std::move(values)});
    EXPECT_TRUE(ports.has_value()) << ports.error().message;
    EXPECT_TRUE(ports->each_connection);
    return make_device_group({&loop, book.log()}, ports->device, ports->driver.spelled());
  }
  std::string report() {
    const Bytes bytes = test::read_file(dir / "report");
    return std::string(as_text(bytes));
  }
  // A tape with one write.
  void tape(const std::string& name, const std::string& text, std::optional<TapeZero> zero = {}) {
    TapeHeader header{.device = "memory", .driver = "test"};
    header.zero = std::move(zero);
    Result<TapeWriter> writer = TapeWriter::create(new_tape(dir / name), header, {});
    ASSERT_TRUE(writer.has_value());
    writer->event(TapeTime{}, event::Open{});
    writer->write_block(tape_time_us(10), as_bytes(text));
    writer->event(tape_time_us(20), event::Close{});
    ASSERT_TRUE(writer->finish(tape_time_us(20)).has_value());
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
};

TEST_F(DeviceGroupTest, ADriversPortThatDoesNotListenIsAUsageError) {
  for (const std::string driver : {"pty", "udp-listen:127.0.0.1:2000", "tcp:127.0.0.1:2000"}) {
    for (const std::string connections : {"one", "each"}) {
      const std::string error =
          error_of(ChannelMode::bridge,
                   {{"device", "tcp:127.0.0.1:1"}, {"driver", driver}, {"connections", connections}});
      EXPECT_NE(error.find("'connections'"), std::string::npos) << driver << ": " << error;
      EXPECT_NE(error.find("does not"), std::string::npos) << error;
    }
  }
}

TEST_F(DeviceGroupTest, ADeviceThatOnlyOneCanHaveIsAUsageError) {
  for (const std::string device : {"/dev/ttyUSB0", "tcp-listen:127.0.0.1:2000", "udp:127.0.0.1:2000",
                                   "unix-listen:/tmp/x", "pty:/tmp/x"}) {
    const Values values{{"device", device}, {"driver", kDriver}, {"connections", "each"}};
    EXPECT_NE(error_of(ChannelMode::bridge, values).find("'connections'"), std::string::npos) << device;
    Values one = values;
    one["connections"] = "one";
    EXPECT_EQ(error_of(ChannelMode::bridge, one), "") << device;
  }
  const std::string error =
      error_of(ChannelMode::record,
               {{"device", "/dev/ttyUSB0"}, {"driver", kDriver}, {"tape", "x"}, {"connections", "each"}});
  EXPECT_NE(error.find("serial:/dev/ttyUSB0 can be open once"), std::string::npos) << error;
}

TEST_F(DeviceGroupTest, EachConnectionHasATapeOfItsOwn) {
  const auto group =
      make(ChannelMode::record, {{"device", "unix:" + (dir / "none") + ",wait"}, {"tape", dir / "laser"}});
  ASSERT_TRUE(group->prepare().has_value());
  EXPECT_FALSE(group->must_not_fail());
  EXPECT_TRUE(group->port_for(1).has_value());
  EXPECT_TRUE(group->port_for(700).has_value());
}

TEST_F(DeviceGroupTest, AMissingDeviceIsToldAtTheStart) {
  const auto group = make(ChannelMode::bridge, {{"device", "unix:" + (dir / "none") + ",alwaysopen"}});
  const Result<void> prepared = group->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::device_missing);
}

TEST_F(DeviceGroupTest, ATapeInTheWayIsToldAtTheStart) {
  tape("laser.c3", "x");
  const auto group = make(ChannelMode::record,
                          {{"device", "tcp:127.0.0.1:1"}, {"tape", dir / "laser"}, {"fail-closed", "on"}});
  EXPECT_TRUE(group->must_not_fail());
  const Result<void> prepared = group->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_NE(prepared.error().message.find("laser.c3.log"), std::string::npos) << prepared.error().message;
}

TEST_F(DeviceGroupTest, AConnectionMeetsTheTapeOfItsNumber) {
  tape("laser", "one");
  tape("laser.c2", "two");
  const auto group = make(ChannelMode::replay, {{"tape", dir / "laser"}});
  ASSERT_TRUE(group->prepare().has_value());
  EXPECT_EQ((*group->port_for(1))->name(), "logreader:" + (dir / "laser.log"));
  EXPECT_EQ((*group->port_for(2))->name(), "logreader:" + (dir / "laser.c2.log"));
  const auto third = group->port_for(3);
  ASSERT_FALSE(third.has_value());
  EXPECT_NE(third.error().message.find("has the tapes of 2 connections, and this is number 3"),
            std::string::npos);
  EXPECT_EQ(group->ends_after(), std::nullopt);
}

TEST_F(DeviceGroupTest, OneTapeIsSpokenOfAsOne) {
  tape("laser", "one");
  const auto group = make(ChannelMode::replay, {{"tape", dir / "laser"}});
  ASSERT_TRUE(group->prepare().has_value());
  EXPECT_EQ(group->port_for(2).error().message,
            (dir / "laser.log") +
                " has the tape of 1 connection, and this is number 2; start again to play it again");
}

TEST_F(DeviceGroupTest, ItsTapesHaveOneReport) {
  tape("laser", "one");
  const auto group = make(ChannelMode::replay, {{"tape", dir / "laser"}, {"report", dir / "report"}});
  EXPECT_TRUE(group->prepare().has_value());
}

TEST_F(DeviceGroupTest, APartWhoseFirstConnectionHadGoneIsPlayedToo) {
  tape("laser.2.c2", "two");
  tape("laser.2.c5", "five");
  const auto group = make(ChannelMode::replay, {{"tape", dir / "laser.2"}});
  ASSERT_TRUE(group->prepare().has_value());
  EXPECT_EQ((*group->port_for(2))->name(), "logreader:" + (dir / "laser.2.c5.log"));
  EXPECT_NE(book.text().find("connection 1 has no tape " + (dir / "laser.2.log") +
                             ": the one that came as number 1 met the tape of connection 2"),
            std::string::npos)
      << book.text();
}

TEST_F(DeviceGroupTest, AnotherConnectionsTapeIsADoubt) {
  for (const bool whole : {true, false}) {
    tape("laser", "one");
    tape(whole ? "laser.c2" : "laser.c3", "two");
    const auto group =
        make(ChannelMode::replay, {{"tape", dir / "laser"}, {"strictness", "0"}, {"report", dir / "report"}});
    ASSERT_TRUE(group->prepare().has_value());
    std::optional<int> status;
    group->finish(0, [&status](int given) { status = given; });
    run_until(loop, [&status] { return status.has_value(); });
    const std::string text = report();
    EXPECT_EQ(text.find("connection 2 has no tape") == std::string::npos, whole) << text;
    for (const auto& entry : std::filesystem::directory_iterator(dir.path())) {
      if (entry.path().filename() != "report") std::filesystem::remove(entry.path());
    }
  }
}

TEST_F(DeviceGroupTest, AConnectionAfterTheLastRunIsADoubtOfThatRun) {
  tape("laser", "one");
  const auto group = make(ChannelMode::replay, {{"tape", dir / "laser"}, {"report", dir / "report"}});
  ASSERT_TRUE(group->prepare().has_value());
  std::optional<int> status;
  group->finish(0, [&status](int given) { status = given; });
  run_until(loop, [&status] { return status.has_value(); });
  EXPECT_EQ(report().find("was turned away"), std::string::npos);
  EXPECT_FALSE(group->port_for(2).has_value());
  status.reset();
  group->finish(1, [&status](int given) { status = given; });
  run_until(loop, [&status] { return status.has_value(); });
  const std::string text = report();
  EXPECT_NE(text.find("connection 2 came and was turned away"), std::string::npos) << text;
  EXPECT_NE(text.find(R"("count":1)"), std::string::npos) << "it is one run still: " << text;
}

TEST_F(DeviceGroupTest, ATapeOfAnotherRecordingIsAUsageError) {
  tape("laser", "one", TapeZero{"2026-01-01T00:00:00Z", 5, "boot"});
  tape("laser.c2", "two", TapeZero{"2026-01-01T00:00:00Z", 5, "boot"});
  const auto good = make(ChannelMode::replay, {{"tape", dir / "laser"}});
  EXPECT_TRUE(good->prepare().has_value());
  tape("laser.c3", "three", TapeZero{"2026-01-01T00:00:00Z", 6, "boot"});
  const auto bad = make(ChannelMode::replay, {{"tape", dir / "laser"}});
  const Result<void> prepared = bad->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
  EXPECT_NE(prepared.error().message.find("laser.c3.log is of another recording"), std::string::npos)
      << prepared.error().message;
}

TEST_F(DeviceGroupTest, TapesThatNobodyCameForAreIncomplete) {
  tape("laser", "one");
  tape("laser.c2", "two");
  const auto group = make(ChannelMode::replay, {{"tape", dir / "laser"}, {"once", "on"}});
  ASSERT_TRUE(group->prepare().has_value());
  EXPECT_EQ(group->ends_after(), 2U);
  std::optional<int> status;
  group->finish(1, [&status](int given) { status = given; });
  run_until(loop, [&status] { return status.has_value(); });
  EXPECT_EQ(status, exit_status::kIncomplete);
  EXPECT_NE(book.text().find("no connection came for the tape " + (dir / "laser.c2.log")), std::string::npos);
  EXPECT_EQ(book.text().find("no connection came for the tape " + (dir / "laser.log")), std::string::npos);
}

}  // namespace
}  // namespace porttape
