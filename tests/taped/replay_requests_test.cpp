// The replaying port: what it refuses, what it tells of itself, and what is in its reports.

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/replay_clock.hpp"
#include "libport/taped/replayed_device.hpp"
#include "libport/taped/replayed_driver.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using Request = PlaybackRequest;

class ReplayRequests : public testing::Test {
 protected:
  ReplayRequests() {
    test::write_file(dir / "t.logw", test::block_bytes({{1'000, "one\n"}, {11'000, "two\n"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{2'000, "1\n"}, {12'000, "2\n"}}));
    options.tape = literal_tape(dir / "t.log");
    options.config.on_mismatch = OnMismatch::fail;
  }
  // Events that close at `close_us`.
  void with_events(std::int64_t close_us = 20'000) {
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                              encode(tape_time_us(close_us), event::Close{}) +
                                              encode(tape_time_us(close_us + 1), event::End{})));
  }
  // What it says that keeps it from playing; empty: it plays.
  std::string prepared() {
    const PortContext context{&loop, book.log()};
    if (options.config.writer == Writer::device) {
      port = std::make_unique<ReplayedDriver>(context, options);
    } else {
      port = std::make_unique<ReplayedDevice>(context, options);
    }
    port->listen(log);
    const Result<void> ready = port->prepare();
    EXPECT_TRUE(ready || ready.error().code == Errc::usage);
    return ready ? std::string() : ready.error().message;
  }
  std::string said_to(const Request& what) {
    const Result<void> done = port->request(what);
    EXPECT_TRUE(done || done.error().code == Errc::usage);
    return done ? std::string() : done.error().message;
  }
  std::string awaits() { return port->waiting()->awaits(); }
  void finish() {
    port->finish();
    run_until(loop, [this] { return log.status.has_value(); });
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  PortLog log;
  ReplayOptions options;
  std::unique_ptr<ReplayPort> port;
};

TEST_F(ReplayRequests, AReportThatHasNoPlaceKeepsItFromPlaying) {
  const std::string folder = dir.path().string();
  options.report_file = folder;
  EXPECT_EQ(prepared(), "report '" + folder + "' is a folder; name a file");
  options.report_file = {};
  options.junit_file = folder;
  EXPECT_EQ(prepared(), "report '" + folder + "' is a folder; name a file");
}

TEST_F(ReplayRequests, AStartIsBeforeTheLastBlock) {
  options.config.start = tape_time_us(12'000);
  EXPECT_EQ(prepared(), "");
  options.config.start = tape_time_us(12'001);
  EXPECT_EQ(prepared(), "option 'start' is 0.012001 s, and nothing of tape '" + options.tape.name() +
                            "' is there; accepted: a time before its end, 0 to 0.012000 s");
}

TEST_F(ReplayRequests, ATapeThatPlaysTheDriverLooksNothingUp) {
  options.config.writer = Writer::device;
  options.config.match = Match::lookup;
  EXPECT_EQ(prepared(), "option 'match': a tape that plays the driver asks in its own order; leave it out");
}

TEST_F(ReplayRequests, NothingIsDoneBeforeTheTapeIsOpen) {
  options.start_paused = true;
  options.config.rate = 2;
  options.config.loops = 3;
  port = std::make_unique<ReplayedDevice>(PortContext{&loop, book.log()}, options);
  EXPECT_EQ(said_to({.kind = Request::Kind::pause}), "the tape is not open yet");
  EXPECT_TRUE(port->playback().paused);
  EXPECT_EQ(port->playback().rate, 2);
  EXPECT_EQ(port->playback().loops, 3U);
  EXPECT_EQ(port->playback().length, std::nullopt);
  EXPECT_EQ(port->playback().position, std::nullopt);
  EXPECT_EQ(awaits(), "");
  port->listen(log);
  port->finish();
  EXPECT_EQ(log.status, 0);
}

TEST_F(ReplayRequests, WhatHasNoMeaningIsRefusedWithWhy) {
  ASSERT_EQ(prepared(), "");
  EXPECT_EQ(said_to({.kind = Request::Kind::step}), "it is not paused; pause it first");
  EXPECT_EQ(said_to({.kind = Request::Kind::seek}),
            "no driver has the port open: it begins at the start with its driver's open");
  EXPECT_EQ(said_to({.kind = Request::Kind::pause}), "");
  EXPECT_TRUE(port->playback().paused);
  EXPECT_EQ(said_to({.kind = Request::Kind::step}),
            "no driver has the port open: there is nothing to step through");
  port->open();
  EXPECT_EQ(said_to({.kind = Request::Kind::resume}), "");
  EXPECT_FALSE(port->playback().paused);
  EXPECT_EQ(said_to({.kind = Request::Kind::rate, .rate = 4}), "");
  EXPECT_EQ(port->playback().rate, 4);
  EXPECT_TRUE(port->playback().position.has_value());
}

TEST_F(ReplayRequests, OfALookupNothingMoves) {
  options.config.match = Match::lookup;
  ASSERT_EQ(prepared(), "");
  port->open();
  const std::string why = "the tape's requests are looked up, whose order is the driver's";
  EXPECT_EQ(said_to({.kind = Request::Kind::seek}), why);
  EXPECT_EQ(said_to({.kind = Request::Kind::step}), why);
  EXPECT_EQ(said_to({.kind = Request::Kind::pause}), "");
}

TEST_F(ReplayRequests, OfATapeThatPlaysTheDriverNothingMoves) {
  options.config.writer = Writer::device;
  ASSERT_EQ(prepared(), "");
  port->open();
  const std::string why = "it plays the driver, whose line has its own course";
  EXPECT_EQ(said_to({.kind = Request::Kind::seek}), why);
  EXPECT_EQ(said_to({.kind = Request::Kind::step}), why);
  EXPECT_EQ(said_to({.kind = Request::Kind::pause}), "");
}

TEST_F(ReplayRequests, OnASharedClockNothingIsAskedFor) {
  options.clock = std::make_shared<ReplayClock>(1);
  ASSERT_EQ(prepared(), "");
  EXPECT_EQ(said_to({.kind = Request::Kind::pause}), "it plays by a clock that other tapes have, too");
}

TEST_F(ReplayRequests, ASeekIsWithinWhatIsPlayed) {
  with_events();
  options.config.start = tape_time_us(1'000);
  ASSERT_EQ(prepared(), "");
  port->open();
  EXPECT_EQ(port->playback().length, Micros(20'001));
  const auto seek = [this](std::int64_t us) {
    return said_to({.kind = Request::Kind::seek, .to = Micros(us)});
  };
  const std::string rest = " s is not on what is played of the tape; accepted: 0.001 to 0.020001 s";
  EXPECT_EQ(seek(999), "seek: 0.000999" + rest);
  EXPECT_EQ(seek(20'002), "seek: 0.020002" + rest);
  EXPECT_EQ(seek(1'000), "");
  EXPECT_EQ(seek(20'001), "");
}

TEST_F(ReplayRequests, WithAnEndThePartIsNoLonger) {
  with_events();
  options.config.end = tape_time_us(15'000);
  ASSERT_EQ(prepared(), "");
  port->open();
  EXPECT_EQ(port->playback().length, Micros(15'000));
  EXPECT_EQ(said_to({.kind = Request::Kind::seek, .to = Micros(15'001)}),
            "seek: 0.015001 s is not on what is played of the tape; accepted: 0 to 0.015 s");
}

TEST_F(ReplayRequests, WithoutEventsASeekMayGoAnywhereBehindTheStart) {
  options.config.start = tape_time_us(1'000);
  ASSERT_EQ(prepared(), "");
  port->open();
  EXPECT_EQ(port->playback().length, std::nullopt);
  EXPECT_EQ(said_to({.kind = Request::Kind::seek, .to = Micros(0)}),
            "seek: 0 s is not on what is played of the tape; accepted: 0.001 to the tape's end s");
  EXPECT_EQ(said_to({.kind = Request::Kind::seek, .to = Micros(5'000'000)}), "");
}

TEST_F(ReplayRequests, LoopsForEverAreNotCounted) {
  options.config.loops = 0;
  ASSERT_EQ(prepared(), "");
  EXPECT_EQ(port->playback().loops, std::nullopt);
}

TEST_F(ReplayRequests, TheWriteThatIsWaitedForIsNamedWithItsPlace) {
  ASSERT_EQ(prepared(), "");
  port->open();
  EXPECT_EQ(awaits(),
            "the tape goes on after a write of \"one\\ntwo\\n\" (offset 0, recorded at 0.001000 s)");
  port->write(as_bytes("on"));
  EXPECT_THAT(awaits(), HasSubstr("(offset 2, recorded at 0.001000 s)"));
}

TEST_F(ReplayRequests, TheReportNamesItsTapeAndConnection) {
  options.connection = 7;
  std::vector<RunReport> reports;
  options.on_report = [&reports](const RunReport& report) { reports.push_back(report); };
  ASSERT_EQ(prepared(), "");
  port->open();
  port->write(as_bytes("oxe\n"));
  finish();
  ASSERT_EQ(reports.size(), 1U);
  EXPECT_EQ(reports[0].tape, options.tape.name());
  EXPECT_EQ(reports[0].connection, 7U);
  EXPECT_EQ(reports[0].session, std::nullopt);
  EXPECT_FALSE(reports[0].nobody_came);
  EXPECT_EQ(reports[0].verdict, Verdict::data_mismatch);
  EXPECT_EQ(log.status, 3);
  EXPECT_THAT(book.text(), HasSubstr(options.tape.name() + ": data mismatch: the driver wrote \"oxe"));
  EXPECT_THAT(book.text(), HasSubstr(options.tape.name() + ": 1 run"));
}

TEST_F(ReplayRequests, SignalsAndBytesThatComeAtOnceAreInTheirOrder) {
  const auto cts = [](std::int64_t us, bool on) {
    return encode(tape_time_us(us), signal_event({Side::device, {LineSignal::Name::cts, on}}));
  };
  std::filesystem::remove(dir / "t.logw");
  test::write_file(dir / "t.logr", test::block_bytes({{10, "ab"}, {20, "cd"}, {30, "ef"}, {40, "gh"}}));
  test::write_file(dir / "t.loge",
                   as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) + cts(25, true) +
                            cts(26, false) + cts(35, true) + encode(tape_time_us(90), event::Close{})));
  options.config.timing = Timing::none;
  ASSERT_EQ(prepared(), "");
  port->tell(line::WatchSignals{true});
  port->open();
  run_until(loop, [this] { return log.data.size() == 8; });
  EXPECT_EQ(log.data, "abcdefgh");
  EXPECT_EQ(log.signals_after, (std::vector<std::size_t>{4, 4, 6}));
  EXPECT_EQ(log.arrivals, 4U);
}

}  // namespace
}  // namespace porttape
