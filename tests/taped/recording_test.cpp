#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "libport/taped/tap_port.hpp"
#include "libport/taped/tape_keeper.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class RecordingTest : public testing::Test {
 protected:
  RecordingTest() { make_port(); }

  void make_port(bool overwrite = false, bool fail_closed = false) {
    port = std::make_unique<TapPort>(PortContext{&loop, book.log()}, std::make_unique<MemoryPort>(device));
    port->add(std::make_unique<TapeKeeper>(
        PortContext{&loop, book.log()},
        TapeKeeper::Options{.tape = tape,
                            .header = {.device = "memory", .driver = "test"},
                            .on_existing = overwrite ? OnExisting::overwrite : OnExisting::refuse,
                            .fail_closed = fail_closed,
                            .retry = std::chrono::milliseconds(1)},
        [this] { port->must_end(); }));
    log.status.reset();
    port->listen(log);
  }
  int finish() {
    port->finish();
    run_until(loop, [this] { return log.status.has_value(); });
    return *log.status;
  }
  void run_until_told(std::string_view text) {
    run_until(loop, [this, text] { return book.text().find(text) != std::string::npos; });
  }
  void pass(std::int64_t us) {
    clock.pass(Micros(us));
    loop.clock_moved();
  }

  static std::string text_of(const Event& event) {
    const auto* settings = std::get_if<event::Settings>(&event);
    if (settings == nullptr) return std::string(name_of(event));
    return fmt::format("{}:{}", settings->by == Side::driver ? "driver" : "device", *settings->line.baud);
  }

  // "open@0 w:ask@10 r:answer@20 …"
  static std::string records(const TapePaths& paths) {
    Result<TapeReader> reader = TapeReader::open(paths);
    if (!reader) return reader.error().message;
    std::string text;
    for (;;) {
      const auto record = reader->next();
      if (!record) return text + record.error().message;
      if (!*record) return text;
      const Record& r = **record;
      const std::string what = r.kind == RecordKind::read      ? "r:" + std::string(as_text(r.data))
                               : r.kind == RecordKind::write   ? "w:" + std::string(as_text(r.data))
                               : r.kind == RecordKind::open    ? "open"
                               : r.kind == RecordKind::close   ? "close"
                               : r.kind == RecordKind::hang_up ? "hang-up"
                                                               : text_of(*r.event);
      text += fmt::format("{}@{} ", what, to_us(r.at));
    }
  }

  test::TempDir dir;
  TapePaths tape = literal_tape((dir.path() / "x.log").string());
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  PortLog log;
  MemoryPort::Peer device;
  std::unique_ptr<TapPort> port;
};

TEST_F(RecordingTest, NoDriverNoTape) {
  ASSERT_TRUE(port->prepare().has_value());
  EXPECT_EQ(finish(), 0);
  EXPECT_TRUE(fs::is_empty(dir.path()));
}

TEST_F(RecordingTest, BothDirectionsAndTheSessionsAreOnTheTape) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  port->write(as_bytes("ask"));
  pass(10);
  device.send("answer");
  pass(10);
  port->close();
  pass(70);
  port->open();
  pass(10);
  EXPECT_EQ(finish(), 0);
  EXPECT_EQ(log.data, "answer");
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(records(tape), "open@0 w:ask@10 r:answer@20 close@30 open@100 close@110 end@110 ");
}

TEST_F(RecordingTest, AnExistingTapeIsFoundBeforeTheDeviceIsTouched) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  finish();
  make_port();
  device.calls.clear();
  const Result<void> prepared = port->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
  EXPECT_EQ(device.calls, "");
  make_port(true);
  EXPECT_TRUE(port->prepare().has_value());
}

TEST_F(RecordingTest, AFaultStandsBeforeTheBlockThatItStruck) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  device.fault({.kind = "drop", .spec = "drop:byte=0:dir=r", .dir = LineDir::r, .offset = 0});
  device.send("nswer");
  pass(10);
  EXPECT_EQ(finish(), 0);
  EXPECT_EQ(records(tape), "open@0 fault@10 r:nswer@10 close@20 end@20 ");
}

TEST_F(RecordingTest, AMarkStandsInItsPlaceAmongTheBlocks) {
  ASSERT_TRUE(port->prepare().has_value());
  Recorder& recorder = *port->recorder();
  const Result<void> early = recorder.request(RecorderRequest::mark("early"));
  ASSERT_FALSE(early.has_value());
  EXPECT_NE(early.error().message.find("no driver has opened the port yet"), std::string::npos);
  EXPECT_EQ(recorder.recording()->state, RecordingStatus::State::waiting);
  port->open();
  port->write(as_bytes("one"));
  pass(5);
  EXPECT_TRUE(recorder.request(RecorderRequest::mark("arm is moving")));
  pass(5);
  port->write(as_bytes("two"));
  port->close();
  EXPECT_TRUE(recorder.request(RecorderRequest::mark("between two drivers")));
  EXPECT_EQ(recorder.recording()->state, RecordingStatus::State::recording);
  EXPECT_EQ(recorder.recording()->tape, tape.name());
  finish();
  EXPECT_FALSE(recorder.request(RecorderRequest::mark("late")));
  EXPECT_FALSE(recorder.recording());
  EXPECT_EQ(records(tape), "open@0 w:one@0 mark@5 w:two@10 close@11 mark@11 end@11 ");
}

TEST_F(RecordingTest, RotationGoesOnWithTheNextName) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->write(as_bytes("one"));
  pass(50);
  EXPECT_TRUE(port->recorder()->request(RecorderRequest::next_tape()));
  pass(5);
  port->write(as_bytes("two"));
  pass(5);
  finish();
  EXPECT_EQ(records(tape), "open@0 w:one@0 end@50 ");
  EXPECT_EQ(records(literal_tape((dir.path() / "x.2.log").string())), "open@0 w:two@5 close@10 end@10 ");
}

TEST_F(RecordingTest, SettingsStandInTheirPlaceAndANextTapeBeginsWithThoseThatHold) {
  device.settings = LineSettings{};
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  port->write(as_bytes("one"));
  port->tell(line::Settings{{.baud = 300}, SettingsOrder::exact});
  port->tell(line::Settings{{.baud = 600}, SettingsOrder::exact});
  pass(40);
  EXPECT_TRUE(port->recorder()->request(RecorderRequest::next_tape()));
  pass(5);
  port->write(as_bytes("two"));
  port->close();
  pass(5);
  EXPECT_TRUE(port->recorder()->request(RecorderRequest::next_tape()));
  finish();
  EXPECT_EQ(records(tape), "open@0 device:9600@0 w:one@10 driver:300@11 driver:600@11 end@50 ");
  EXPECT_EQ(records(literal_tape((dir.path() / "x.2.log").string())),
            "open@0 device:9600@0 driver:600@0 w:two@5 close@6 end@10 ");
  EXPECT_EQ(records(literal_tape((dir.path() / "x.3.log").string())), "device:9600@0 end@0 ");
}

TEST_F(RecordingTest, SettingsFromBeforeATapeThatComesLaterAreOnIt) {
  device.settings = LineSettings{};
  device.up_at_once = false;
  make_port(true);
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  port->tell(line::Settings{{.baud = 300}, SettingsOrder::exact});
  pass(10);
  device.up();
  finish();
  EXPECT_EQ(records(tape), "open@0 driver:300@10 device:9600@20 close@20 end@20 ");
}

TEST_F(RecordingTest, ARotationThatComesAfterTheEndMakesNoTape) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->write(as_bytes("one"));
  port->finish();  // whose end the loop tells
  EXPECT_FALSE(port->recorder()->request(RecorderRequest::next_tape()));
  run_until(loop, [this] { return log.status.has_value(); });
  EXPECT_EQ(log.status, 0);
  EXPECT_EQ(records(tape), "open@0 w:one@0 close@1 end@1 ");
  EXPECT_FALSE(fs::exists(literal_tape((dir.path() / "x.2.log").string()).read));
}

TEST_F(RecordingTest, TheNextPartKnowsTheOneBefore) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(50);
  EXPECT_TRUE(port->recorder()->request(RecorderRequest::next_tape()));
  EXPECT_EQ(finish(), 0);
  const auto first = TapeReader::open(tape)->header();
  const auto second = TapeReader::open(literal_tape((dir.path() / "x.2.log").string()))->header();
  ASSERT_TRUE(first && second);
  EXPECT_FALSE(first->previous);
  EXPECT_EQ(second->previous, (PreviousTape{first->id, "x.log"}));
  ASSERT_TRUE(first->zero && second->zero);
  EXPECT_EQ(second->zero->monotonic_us - first->zero->monotonic_us, 50);
}

TEST_F(RecordingTest, TheLineStaysUpWhenTheTapeCannotBeMade) {
  ASSERT_TRUE(port->prepare().has_value());
  fs::remove_all(dir.path());
  port->open();
  port->write(as_bytes("ask"));
  device.send("answer");
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(log.data, "answer");
  run_until_told("the line stays up");
  EXPECT_EQ(finish(), exit_status::kRuntime);
  EXPECT_NE(book.text().find("9 bytes passed and are on no tape"), std::string::npos) << book.text();
}

TEST_F(RecordingTest, AnEndBeforeItIsKnownThatTheTapeCannotBeMadeTellsWhatIsOnNone) {
  ASSERT_TRUE(port->prepare().has_value());
  fs::remove_all(dir.path());
  port->open();
  port->write(as_bytes("ask"));
  device.send("answer");
  EXPECT_EQ(finish(), exit_status::kRuntime);
  EXPECT_NE(book.text().find("9 bytes passed and are on no tape"), std::string::npos) << book.text();
}

TEST_F(RecordingTest, ATapeThatCouldNotBeMadeIsTriedAgainAndSaysWhatIsMissing) {
  ASSERT_TRUE(port->prepare().has_value());
  fs::remove_all(dir.path());
  port->open();
  pass(1'000'000);
  port->write(as_bytes("lost"));
  run_until_told("nothing is recorded");
  fs::create_directory(dir.path());
  let_pass(loop, clock, Micros(1'000'000));  // it is tried again every millisecond
  run_until_told("recording to");
  port->write(as_bytes("kept"));
  EXPECT_EQ(finish(), exit_status::kRuntime);
  EXPECT_EQ(records(tape), "open@0 gap@2000000 w:kept@2000000 close@2000001 end@2000001 ");
}

TEST_F(RecordingTest, RotationToANameThatCannotBeMadeKeepsTheLine) {
  tape = literal_tape(dir / (std::string(253, 'a')));
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_TRUE(port->recorder()->request(RecorderRequest::next_tape()));
  port->write(as_bytes("ask"));
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(finish(), exit_status::kRuntime);
}

TEST_F(RecordingTest, FailClosedAsksForTheEndWhenTheTapeCannotBeMade) {
  make_port(false, true);
  ASSERT_TRUE(port->prepare().has_value());
  fs::remove_all(dir.path());
  port->open();
  run_until(loop, [this] { return log.events.find("finished1") != std::string::npos; });
}

TEST_F(RecordingTest, ALostDeviceIsOnTheTape) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  device.down(LineDown::Reason::lost, "unplugged");
  finish();
  EXPECT_EQ(records(tape), "open@0 hang-up@10 close@10 end@10 ");
}

TEST_F(RecordingTest, ADeviceThatEndsTheLineHangsUpOnTheTapeUnlessTheDriverEndedFirst) {
  ASSERT_TRUE(port->prepare().has_value());
  const auto session = [this](bool driver_ends, LineDown::Reason reason) {
    port->open();
    if (driver_ends) port->end_writing();
    pass(10);
    device.down(reason, "it has gone");
    port->close();
    pass(90);
  };
  session(false, LineDown::Reason::closed);
  session(false, LineDown::Reason::failed);
  session(true, LineDown::Reason::closed);
  session(true, LineDown::Reason::lost);
  session(false, LineDown::Reason::closed);
  finish();
  EXPECT_EQ(records(tape),
            "open@0 hang-up@10 close@10 open@100 hang-up@110 close@110 open@200 half-close@200 close@210 "
            "open@300 half-close@300 hang-up@310 close@310 open@400 hang-up@410 close@410 end@500 ");
}

TEST_F(RecordingTest, ADeviceThatComesBackIsOnTheTapeAndTheSessionIsTold) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  device.interrupt();
  pass(10);
  device.resume();
  finish();
  EXPECT_EQ(records(tape), "open@0 device-lost@10 device-back@20 close@20 end@20 ");
  EXPECT_EQ(log.events, "up interrupted resumed ");
}

TEST_F(RecordingTest, WhatDidNotReachTheDeviceIsAGap) {
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  pass(10);
  device.drop(7);
  finish();
  EXPECT_EQ(records(tape), "open@0 gap@10 close@10 end@10 ");
  EXPECT_EQ(log.dropped, 7U);
}

}  // namespace
}  // namespace porttape
