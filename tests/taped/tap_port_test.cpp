// Observers of a tap: what each is told, and how their ends make the port's.

#include "libport/taped/tap_port.hpp"

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/line/line_settings_text.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

class Notes final : public LineObserver {
 public:
  struct Book {
    std::string text;
    std::function<void(bool)> done;
    Result<void> ready;
    bool done_when_given_up = false;
    bool finishes_at_once = false;
    Result<bool> request_is_for_it = true;
  };
  explicit Notes(Book& book) : book_(&book) {}
  [[nodiscard]] Result<void> check() const override { return book_->ready; }
  void opened(Instant) override { book_->text += "opened "; }
  void came_up(Instant) override { book_->text += "up "; }
  void closed(Instant) override { book_->text += "closed "; }
  void block(Direction direction, Instant, ByteView data) override {
    book_->text += (direction == Direction::read ? "r:" : "w:") + std::string(as_text(data)) + " ";
  }
  void note(Instant, const Event& event) override {
    book_->text += name_of(event);
    if (const auto* settings = std::get_if<event::Settings>(&event)) {
      book_->text += settings->by == Side::driver ? "[driver " : "[device ";
      book_->text += to_text(settings->line);
      book_->text += settings->order == SettingsOrder::sampled ? ", sampled]" : "]";
    }
    if (const auto signal = signal_of(event)) {
      book_->text += signal->by == Side::driver ? "[driver " : "[device ";
      book_->text += name_of(signal->signal.name);
      book_->text += signal->signal.on ? " on]" : " off]";
    }
    book_->text += ' ';
  }
  Result<bool> request(Instant, const RecorderRequest&) override {
    book_->text += "next_tape ";
    return book_->request_is_for_it;
  }
  void finish(Instant, std::function<void(bool)> done) override {
    book_->done = std::move(done);
    if (!book_->finishes_at_once) return;
    book_->text += "finish ";
    book_->done(true);
  }
  void give_up() override {
    book_->text += "give_up ";
    if (book_->done_when_given_up) book_->done(true);
  }

 private:
  Book* book_;
};

// Answers within write, and takes two bytes at most of one who waits in its calls.
class Prompt final : public ForwardingPort {
 public:
  using ForwardingPort::ForwardingPort;
  void write(ByteView data) override {
    on_data(as_bytes("prompt"));
    ForwardingPort::write(data);
  }
  [[nodiscard]] PortFacets facets() override { return {.waiting = this}; }
  std::size_t write_some(ByteView data) override { return std::min<std::size_t>(data.size(), 2); }
};

// Drops what waits, or has passed it on already.
class Dropping final : public ForwardingPort {
 public:
  Dropping(std::unique_ptr<Port> inner, bool drops) : ForwardingPort(std::move(inner)), drops_(drops) {}
  [[nodiscard]] PortFacets facets() override { return {.waiting = this}; }
  bool discard() override { return drops_; }

 private:
  bool drops_;
};

// Reads within whatever it is asked for, as ports do that look for what is left.
class RereadingPort final : public ForwardingPort {
 public:
  RereadingPort(std::unique_ptr<Port> inner, std::function<void()> read)
      : ForwardingPort(std::move(inner)), read_(std::move(read)) {}
  void open() override { read_(); }
  void close() override { read_(); }
  void hang_up(bool) override { read_(); }
  void read_pending() override { read_(); }
  void set_reading(bool) override { read_(); }

 private:
  std::function<void()> read_;
};

// Does something once within on_data.
class Busy final : public PortListener {
 public:
  void on_up() override {}
  void on_data(ByteView) override {
    if (const auto work = std::exchange(within_data, {})) work();
  }
  void on_drained() override {}
  void on_down(const LineDown&) override {}
  void on_finished(int) override {}
  void on_complete(int) override { completed = true; }
  std::function<void()> within_data;
  bool completed = false;
};

class TapPortTest : public testing::Test {
 protected:
  TapPortTest()
      : tap({&loop, book.log()}, std::make_unique<MemoryPort>(device), std::chrono::milliseconds(1)) {
    tap.add(std::make_unique<Notes>(one));
    tap.add(std::make_unique<Notes>(other));
    tap.listen(log);
  }
  Loop loop;
  LogBook book;
  MemoryPort::Peer device;
  Notes::Book one;
  Notes::Book other;
  PortLog log;
  TapPort tap;
};

TEST_F(TapPortTest, EveryObserverIsToldAllThatPasses) {
  ASSERT_TRUE(tap.prepare().has_value());
  tap.open();
  tap.write(as_bytes("ask"));
  device.send("answer");
  device.arrive("abc", {1, 3});
  tap.tell(line::Flush{FlushQueue::in});
  EXPECT_TRUE(tap.recorder()->request(RecorderRequest::next_tape()));
  tap.close();
  EXPECT_EQ(one.text, "opened up w:ask r:answer r:a r:bc flush next_tape closed ");
  EXPECT_EQ(other.text, one.text);
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(log.data, "answerabc");
}

TEST_F(TapPortTest, ADevicesHalfCloseIsToldUnlessAnotherDeviceMayFollowIt) {
  ASSERT_TRUE(tap.prepare().has_value());
  tap.open();
  device.end();
  EXPECT_EQ(one.text, "opened up half-close ");
  device.passive = true;
  device.end();
  EXPECT_EQ(one.text, "opened up half-close ") << "the driver is not told of it either";
  EXPECT_EQ(log.events, "up ended ended ");
}

TEST_F(TapPortTest, SettingsAreToldWhenTheLineComesUpAndWhenOneOfThemChangesThem) {
  device.settings = LineSettings{};
  ASSERT_TRUE(tap.prepare().has_value());
  tap.open();
  EXPECT_EQ(one.text, "opened up settings[device 9600 baud, 8N1] ");
  one.text.clear();
  tap.tell(line::Settings{{.baud = 115200, .stop_bits = 1}, SettingsOrder::sampled});
  tap.tell(line::Settings{{.baud = 115200, .stop_bits = 1}, SettingsOrder::sampled});
  device.set({.baud = 57600});
  EXPECT_EQ(one.text, "settings[driver 115200 baud, 1 stop bit, sampled] settings[device 57600 baud] ");
  EXPECT_EQ(log.settings.baud, 57600U);
  EXPECT_EQ(device.calls, "prepare open peer_set peer_set ");
  one.text.clear();
  device.interrupt();
  device.resume();
  EXPECT_EQ(one.text, "device-lost device-back settings[device 9600 baud, 8N1] ");
  EXPECT_EQ(other.text.substr(other.text.size() - one.text.size()), one.text);
}

TEST_F(TapPortTest, SignalsAndDrainsHaveTheirPlaceAmongTheBlocks) {
  tap.open();
  one.text.clear();
  device.calls.clear();
  device.signal({LineSignal::Name::cts, true});
  tap.write(as_bytes("a"));
  tap.tell(LineSignal{LineSignal::Name::rts, false});
  int sent = 0;
  log.drain(tap, [&sent] { ++sent; });
  tap.tell(LineSignal{LineSignal::Name::brk, true});
  device.drains.at(0)();
  EXPECT_EQ(sent, 1);
  EXPECT_EQ(one.text, "modem[device cts on] w:a modem[driver rts off] break[driver break on] drain ");
  EXPECT_EQ(device.calls, "rts_off drain break_on ");
}

TEST_F(TapPortTest, ADrainThatTheLinesEndHasEndedIsNotNoted) {
  tap.open();
  int sent = 0;
  log.drain(tap, [&sent] { ++sent; });
  tap.close();
  tap.open();
  one.text.clear();
  device.drains.at(0)();
  EXPECT_EQ(sent, 1);
  EXPECT_EQ(one.text, "");
}

TEST_F(TapPortTest, ADeviceThatRefusesIsToldWithWhatItHas) {
  device.settings = LineSettings{};
  device.takes_settings = false;
  tap.open();
  one.text.clear();
  tap.tell(line::Settings{{.baud = 7}, SettingsOrder::exact});
  EXPECT_FALSE(tap.apply({.baud = 7}).has_value());
  EXPECT_EQ(one.text, "settings[driver 7 baud] settings[device 9600 baud, 8N1] ");
}

TEST_F(TapPortTest, ALineWithoutSettingsHasThoseOfItsDriver) {
  tap.open();
  tap.tell(line::Settings{{.baud = 7}, SettingsOrder::exact});
  EXPECT_EQ(one.text, "opened up settings[driver 7 baud] ");
}

TEST_F(TapPortTest, AFloodOfFlushesIsTheDevicesToSeeAndToldOnce) {
  const Instant begin = loop.now();
  int flushes = 0;
  for (; flushes < 10'000; ++flushes) tap.tell(line::Flush{FlushQueue::in});
  const auto told = static_cast<std::int64_t>(one.text.size() / std::string_view("flush ").size());
  EXPECT_LE(told, 1 + (loop.now() - begin) / RepeatFilter::kFlushes);
  EXPECT_EQ(device.calls.size(), std::string_view("peer_flushed ").size() * 10'000);
  one.text.clear();
  device.send("a");
  tap.tell(line::Flush{FlushQueue::in});
  EXPECT_EQ(one.text, "r:a flush ");
}

TEST_F(TapPortTest, WhatIsWrittenWithinOnDataIsToldBehindIt) {
  Busy busy;
  tap.listen(busy);
  busy.within_data = [this] {
    tap.write(as_bytes("more"));
    device.send("at once");
    tap.tell(line::Flush{FlushQueue::in});
  };
  device.send("answer");
  device.send("next");
  EXPECT_EQ(one.text, "r:answer w:more r:at once flush r:next ");
  EXPECT_EQ(other.text, one.text);
}

TEST_F(TapPortTest, ACloseWithinOnDataIsToldBehindItAndTheEndToo) {
  Busy busy;
  tap.listen(busy);
  tap.open();
  one.finishes_at_once = other.finishes_at_once = true;
  busy.within_data = [this] {
    tap.finish();
    EXPECT_EQ(one.text, "opened up r:data closed finish ");
  };
  device.send("data");
  EXPECT_EQ(one.text, "opened up r:data closed finish ");
  EXPECT_TRUE(busy.completed);
}

TEST_F(TapPortTest, ADeviceThatAnswersWithinWriteAnswersBehindIt) {
  TapPort around({&loop, book.log()}, std::make_unique<Prompt>(std::make_unique<MemoryPort>(device)));
  around.add(std::make_unique<Notes>(one));
  Busy busy;
  around.listen(busy);
  busy.within_data = [&] { EXPECT_EQ(around.waiting()->write_some(as_bytes("some")), 2U); };
  around.write(as_bytes("ask"));
  EXPECT_EQ(one.text, "w:ask r:prompt w:so ");
}

TEST_F(TapPortTest, WhatIsNotToBeDroppedIsNoFlush) {
  for (const bool drops : {true, false}) {
    TapPort around({&loop, book.log()},
                   std::make_unique<Dropping>(std::make_unique<MemoryPort>(device), drops));
    around.add(std::make_unique<Notes>(one));
    one.text.clear();
    EXPECT_EQ(around.waiting()->discard(), drops);
    EXPECT_EQ(one.text, drops ? "flush " : "");
  }
}

TEST_F(TapPortTest, AReadWithinOnDataDoesNotChangeWhatIsTold) {
  std::string buffer;
  TapPort around({&loop, book.log()},
                 std::make_unique<RereadingPort>(std::make_unique<MemoryPort>(device), [&] {
                   buffer.replace(0, 5, "other");
                   device.send(buffer);
                 }));
  around.add(std::make_unique<Notes>(one));
  Busy busy;
  around.listen(busy);
  const std::vector<std::function<void()>> calls = {
      [&] { around.read_pending(); }, [&] { around.set_reading(true); }, [&] { around.hang_up(false); },
      [&] { around.open(); },         [&] { around.close(); },
  };
  for (std::size_t i = 0; i < calls.size(); ++i) {
    one.text.clear();
    buffer = "first";
    busy.within_data = calls[i];
    device.send(buffer);
    EXPECT_TRUE(one.text.starts_with("r:first ")) << i << ": " << one.text;
    EXPECT_NE(one.text.find("r:other "), std::string::npos) << i << ": " << one.text;
  }
}

TEST_F(TapPortTest, NothingIsNoBlock) {
  ASSERT_TRUE(tap.prepare().has_value());
  tap.open();
  tap.write({});
  device.send("");
  device.arrive("a", {0, 1});
  EXPECT_EQ(one.text, "opened up r:a ");
}

TEST_F(TapPortTest, OneThatIsNotReadyKeepsTheLineFromComing) {
  other.ready = make_error(Errc::usage, "no place");
  EXPECT_FALSE(tap.prepare().has_value());
  EXPECT_EQ(device.calls, "");
}

TEST_F(TapPortTest, TheEndWaitsForAllAndFailsWithTheFirstThatLostSomething) {
  tap.finish();
  EXPECT_EQ(log.status, std::nullopt);
  one.done(false);
  EXPECT_EQ(log.status, std::nullopt);
  other.done(true);
  EXPECT_EQ(log.status, exit_status::kRuntime);
}

TEST_F(TapPortTest, TheEndWaitsForNoneForEver) {
  tap.finish();
  one.done(true);
  run_until(loop, [this] { return log.status.has_value(); });
  EXPECT_EQ(log.status, exit_status::kRuntime);
  EXPECT_EQ(one.text, "");
  EXPECT_EQ(other.text, "give_up ");
}

TEST_F(TapPortTest, GoneBeforeItsEndItGivesUpThoseThatHaveNotFinished) {
  auto sooner =
      std::make_unique<TapPort>(PortContext{&loop, book.log()}, std::make_unique<MemoryPort>(device));
  sooner->add(std::make_unique<Notes>(one));
  sooner->add(std::make_unique<Notes>(other));
  sooner->listen(log);
  sooner->finish();
  one.done(true);
  sooner.reset();
  EXPECT_EQ(one.text, "");
  EXPECT_EQ(other.text, "give_up ");
  EXPECT_EQ(log.status, std::nullopt);
}

TEST_F(TapPortTest, OneThatWasGivenUpCannotSayAnyMoreThatItIsComplete) {
  other.done_when_given_up = true;
  tap.finish();
  one.done(true);
  run_until(loop, [this] { return log.status.has_value(); });
  EXPECT_EQ(log.status, exit_status::kRuntime);
}

TEST_F(TapPortTest, AfterTheirFinishObserversAreToldNothingAndTheLogIsToldOfTheBytes) {
  ASSERT_TRUE(tap.prepare().has_value());
  tap.open();
  tap.finish();
  one.text.clear();
  EXPECT_FALSE(tap.recorder()->request(RecorderRequest::next_tape()));
  tap.write(as_bytes("four"));
  device.send("three");
  device.interrupt();
  tap.recorder()->note_gap(2, "a test wants it");
  EXPECT_EQ(one.text, "");
  EXPECT_EQ(device.written, "four");
  EXPECT_EQ(log.data, "three");
  one.done(true);
  other.done(true);
  EXPECT_EQ(log.status, exit_status::kRuntime);
  EXPECT_NE(book.text().find("memory: 9 bytes came after the end"), std::string::npos) << book.text();
}

}  // namespace
}  // namespace porttape
