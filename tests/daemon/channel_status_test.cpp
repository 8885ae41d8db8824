#include "daemon/channel_status.hpp"

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>

#include "daemon/notify.hpp"
#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::Not;

ChannelStatus some_status() {
  return {.mode = "record",
          .driver = "pty",
          .device = "serial:/dev/ttyUSB0",
          .counters = {.to_driver_bytes = 1, .from_driver_bytes = 2, .dropped_bytes = 3, .opens = 4}};
}

std::string text_of(const ChannelStatus& status) { return to_json("laser", status).str(); }

LineStatus line_in(Session::State state) {
  return {.state = state, .driver = "d", .driver_node = {}, .device = "e", .recording = {}};
}

TEST(ChannelStatus, AllThatIsToldOfALine) {
  ChannelStatus status = some_status();
  status.lines.push_back({.state = Session::State::open,
                          .driver = "pty",
                          .driver_node = "/dev/pts/3",
                          .device = "serial:/dev/ttyUSB0",
                          .recording = RecordingStatus{.state = RecordingStatus::State::failing,
                                                       .tape = "laser.log",
                                                       .bytes = 5,
                                                       .lost_bytes = 6,
                                                       .queued_bytes = 7,
                                                       .why = "disk full"},
                          .playback = PlaybackStatus{.paused = true,
                                                     .rate = 2.5,
                                                     .position = Micros(1'500'000),
                                                     .loop = 2,
                                                     .loops = 3,
                                                     .length = Micros(250'000)}});
  EXPECT_EQ(text_of(status),
            R"({"name":"laser","mode":"record","state":"open","driver":"pty","device":"serial:/dev/ttyUSB0",)"
            R"("from_driver_bytes":2,"to_driver_bytes":1,"dropped_bytes":3,"opens":4,)"
            R"("lines":[{"state":"open","driver":"pty","driver_node":"/dev/pts/3",)"
            R"("device":"serial:/dev/ttyUSB0","playback":{"paused":true,"position_s":1.5,"length_s":0.25,)"
            R"("rate":2.5,"loop":2,"loops":3}}],)"
            R"("tapes":[{"name":"laser.log","state":"failing","bytes":5,"lost_bytes":6,"queued_bytes":7,)"
            R"("why":"disk full"}],"last_trouble":null})");
}

TEST(ChannelStatus, WhatIsNotKnownIsNull) {
  ChannelStatus status = some_status();
  status.lines.push_back(line_in(Session::State::waiting));
  status.lines.back().playback = PlaybackStatus{.loops = std::nullopt};
  const std::string text = text_of(status);
  EXPECT_THAT(text, HasSubstr(R"("driver_node":null)"));
  EXPECT_THAT(text, HasSubstr(R"("paused":false,"position_s":null,"length_s":null)"));
  EXPECT_THAT(text, HasSubstr(R"("loops":null)"));
  EXPECT_THAT(text, HasSubstr(R"("tapes":[])"));
  for (const char* const absent : {"retry_in_s", "why", "exit_status"})
    EXPECT_THAT(text, Not(HasSubstr(absent)));
}

TEST(ChannelStatus, EachStateHasItsWord) {
  using State = Session::State;
  for (const auto& [state, word] : {std::pair(State::waiting, "waiting"),
                                    {State::opening, "opening"},
                                    {State::open, "open"},
                                    {State::interrupted, "interrupted"},
                                    {State::broken, "broken"},
                                    {State::draining, "draining"},
                                    {State::ending, "ending"}}) {
    ChannelStatus status = some_status();
    status.lines.push_back(line_in(state));
    EXPECT_THAT(text_of(status), HasSubstr(std::string(R"("state":")") + word + R"(","driver":"pty")"));
  }
  using Tape = RecordingStatus::State;
  for (const auto& [state, word] : {std::pair(Tape::waiting, "waiting"),
                                    {Tape::recording, "recording"},
                                    {Tape::failing, "failing"},
                                    {Tape::not_made, "not-made"}}) {
    ChannelStatus status = some_status();
    status.lines.push_back(line_in(State::open));
    status.lines.back().recording = RecordingStatus{.state = state, .tape = "t"};
    EXPECT_THAT(text_of(status), HasSubstr(std::string(R"("tapes":[{"name":"t","state":")") + word + '"'));
  }
}

TEST(ChannelStatus, OfSeveralLinesTheFirstThatDoesSomethingIsTheChannels) {
  ChannelStatus status = some_status();
  EXPECT_THAT(text_of(status), HasSubstr(R"("state":"retrying")"));
  status.lines = {line_in(Session::State::waiting), line_in(Session::State::draining),
                  line_in(Session::State::open)};
  EXPECT_THAT(text_of(status), HasSubstr(R"("mode":"record","state":"draining")"));
  status.ended = 3;
  EXPECT_THAT(text_of(status), HasSubstr(R"("mode":"record","state":"ended")"));
  EXPECT_THAT(text_of(status), HasSubstr(R"("exit_status":3)"));
}

TEST(ChannelStatus, ARetryIsInWholeSecondsThatAreNotOverYet) {
  ChannelStatus status = some_status();
  status.retry_in = std::chrono::milliseconds(1'001);
  status.why = "no device";
  EXPECT_THAT(text_of(status), HasSubstr(R"("retry_in_s":2,"why":"no device")"));
}

TEST(ChannelStatus, TheLastTroubleHasItsMomentInUtc) {
  ChannelStatus status = some_status();
  status.trouble = LastTrouble::Told{WallTime(std::chrono::seconds(1'700'000'000)), "it broke"};
  EXPECT_THAT(text_of(status),
              HasSubstr(R"("last_trouble":{"at":"2023-11-14T22:13:20Z","text":"it broke"}})"));
}

TEST(ChannelStatus, TheDeviceOfAReplayIsItsTape) {
  const std::map<std::string, std::string> values{
      {"driver", "pty"}, {"device", "serial:/dev/ttyUSB0"}, {"tape", "laser.log"}};
  const ChannelStatus replay = described({ChannelMode::replay, values});
  EXPECT_EQ(replay.mode, "replay");
  EXPECT_EQ(replay.driver, "pty");
  EXPECT_EQ(replay.device, "laser.log");
  const ChannelStatus record = described({ChannelMode::record, values});
  EXPECT_EQ(record.mode, "record");
  EXPECT_EQ(record.device, "serial:/dev/ttyUSB0");
  EXPECT_EQ(described({ChannelMode::bridge, {}}).device, "");
}

TEST(LastTroubleTest, OnlyWarningsAndWorseAreKept) {
  const auto sink = std::make_shared<LastTrouble>();
  spdlog::logger log("test", sink);
  log.info("all is well");
  EXPECT_FALSE(sink->told().has_value());
  log.warn("not quite");
  log.info("all is well");
  ASSERT_TRUE(sink->told().has_value());
  EXPECT_EQ(sink->told()->text, "not quite");
  log.error("worse");
  EXPECT_EQ(sink->told()->text, "worse");
}

// sd_notify(3): a datagram socket whose name is in the environment.
class NotifyTest : public testing::Test {
 protected:
  void TearDown() override { ::unsetenv("NOTIFY_SOCKET"); }
  static UniqueFd listen_on(const std::string& name) {
    UniqueFd fd(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    name.copy(address.sun_path, sizeof address.sun_path);
    const bool is_abstract = address.sun_path[0] == '@';
    if (is_abstract) address.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    EXPECT_EQ(::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size), 0) << name;
    return fd;
  }
  static std::string told_on(const UniqueFd& fd) {
    std::array<char, 64> text{};
    const ssize_t size = ::recv(fd.get(), text.data(), text.size(), 0);
    return size < 0 ? "nothing" : std::string(text.data(), static_cast<std::size_t>(size));
  }
};

TEST_F(NotifyTest, ASocketInAFolderAndAnAbstractOneAreTold) {
  const test::TempDir dir;
  for (const std::string& name : {dir / "notify", "@porttape-test-" + std::to_string(::getpid())}) {
    const UniqueFd listener = listen_on(name);
    ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
    notify_systemd("READY=1");
    EXPECT_EQ(told_on(listener), "READY=1") << name;
  }
}

TEST_F(NotifyTest, TheLongestNameIsTaken) {
  const std::string name = "@" + std::string(sizeof(sockaddr_un::sun_path) - 1, 'n');
  const UniqueFd listener = listen_on(name);
  ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
  notify_systemd("READY=1");
  EXPECT_EQ(told_on(listener), "READY=1");
  const std::string longer = name + "n";
  ::setenv("NOTIFY_SOCKET", longer.c_str(), 1);
  notify_systemd("READY=1");
  EXPECT_EQ(told_on(listener), "nothing");
}

TEST_F(NotifyTest, WithoutASocketNobodyIsTold) {
  ::unsetenv("NOTIFY_SOCKET");
  notify_systemd("READY=1");
  ::setenv("NOTIFY_SOCKET", "", 1);
  notify_systemd("READY=1");
}

}  // namespace
}  // namespace porttape
