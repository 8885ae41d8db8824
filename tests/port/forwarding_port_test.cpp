// A wrapper passes on every call of both interfaces.

#include "libport/port/forwarding_port.hpp"

#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"

namespace porttape {
namespace {

// Says of each call that it came; what it gives is never a default.
class ToldPort final : public Port, private WaitingCalls, private Recorder, private Playback {
 public:
  explicit ToldPort(std::vector<std::string>& calls) : calls_(&calls) {}
  Result<void> prepare() override {
    say("prepare");
    return make_error(Errc::usage, "told");
  }
  void open() override { say("open"); }
  void close() override { say("close"); }
  void write(ByteView data) override { say("write " + std::string(as_text(data))); }
  [[nodiscard]] bool congested() const override { return true; }
  bool end_writing() override { return true; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return 7; }
  [[nodiscard]] std::optional<LineSettings> settings() const override { return LineSettings{.baud = 7}; }
  Result<void> apply(const LineSettings& settings) override {
    say("apply " + std::to_string(settings.baud));
    return {};
  }
  void tell(const LineEvent& event) override {
    say("tell " + std::to_string(event.index()));
    Port::tell(event);
  }
  void set_reading(bool on) override { say(on ? "reading" : "not reading"); }
  void hang_up(bool after_reading) override { say(after_reading ? "hang up later" : "hang up"); }
  void read_pending() override { say("read pending"); }
  [[nodiscard]] bool left_bytes() const override { return true; }
  void finish() override { say("finish"); }
  [[nodiscard]] PortFacets facets() override { return {.waiting = this, .recorder = this, .playback = this}; }
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = true, .keeps_datagrams = true, .has_half_close = true, .shows_signals = true};
  }
  [[nodiscard]] std::string name() const override { return "told"; }
  [[nodiscard]] PortPlace place() const override { return {.node = "/dev/told"}; }

  PortListener& outer() { return listener(); }

 private:
  std::size_t write_some(ByteView) override { return 3; }
  [[nodiscard]] std::size_t unsent() override { return 4; }
  bool discard() override { return false; }
  [[nodiscard]] std::string awaits() override { return "told"; }
  [[nodiscard]] std::optional<Instant> next_due() override { return Instant{}; }
  Result<void> request(const RecorderRequest&) override { return {}; }
  Result<void> request(const PlaybackRequest&) override { return {}; }
  [[nodiscard]] PlaybackStatus playback() override { return {}; }
  void note_gap(std::uint64_t, std::string_view) override {}
  void say(std::string call) { calls_->push_back(std::move(call)); }

  std::vector<std::string>* calls_;
};

class Wrapper final : public ForwardingPort {
 public:
  using ForwardingPort::ForwardingPort;
};

class ForwardingPortTest : public testing::Test {
 protected:
  ForwardingPortTest() : wrapper(std::make_unique<ToldPort>(calls)) { wrapper.listen(log); }
  std::vector<std::string> calls;
  PortLog log;
  Wrapper wrapper;
};

TEST_F(ForwardingPortTest, PassesOnEveryCallToTheInnerPort) {
  EXPECT_FALSE(wrapper.prepare().has_value());
  wrapper.open();
  wrapper.write(as_bytes("x"));
  EXPECT_TRUE(wrapper.apply({.baud = 300}).has_value());
  wrapper.tell(LineSignal{LineSignal::Name::rts, true});
  bool sent = false;
  log.drain(wrapper, [&sent] { sent = true; });
  EXPECT_TRUE(sent);
  std::optional<LineAnswer> answer = LineAnswer{};
  log.ask(wrapper, {}, [&answer](const std::optional<LineAnswer>& given) { answer = given; });
  EXPECT_EQ(answer, std::nullopt);
  EXPECT_TRUE(wrapper.shows_signals());
  wrapper.set_reading(false);
  wrapper.hang_up(true);
  wrapper.read_pending();
  wrapper.tell(line::Flush{FlushQueue::in});
  wrapper.close();
  wrapper.finish();
  EXPECT_EQ(calls, (std::vector<std::string>{"prepare", "open", "write x", "apply 300", "tell 2", "tell 3",
                                             "tell 5", "not reading", "hang up later", "read pending",
                                             "tell 0", "close", "finish"}));
  EXPECT_TRUE(wrapper.congested());
  EXPECT_TRUE(wrapper.end_writing());
  EXPECT_TRUE(wrapper.has_half_close());
  EXPECT_EQ(wrapper.unread_by_peer(), 7U);
  EXPECT_TRUE(wrapper.left_bytes());
  EXPECT_EQ(wrapper.settings(), LineSettings{.baud = 7});
  ASSERT_NE(wrapper.waiting(), nullptr);
  EXPECT_EQ(wrapper.waiting()->write_some(as_bytes("x")), 3U);
  EXPECT_EQ(wrapper.waiting()->unsent(), 4U);
  EXPECT_FALSE(wrapper.waiting()->discard());
  EXPECT_EQ(wrapper.waiting()->awaits(), "told");
  EXPECT_EQ(wrapper.waiting()->next_due(), Instant{});
  EXPECT_NE(wrapper.recorder(), nullptr);
  EXPECT_NE(wrapper.playback_control(), nullptr);
  EXPECT_TRUE(wrapper.passive());
  EXPECT_TRUE(wrapper.keeps_datagrams());
  EXPECT_EQ(wrapper.name(), "told");
  EXPECT_EQ(wrapper.place().node, "/dev/told");
}

// Notes all that PortLog does, and the rest.
class WholeLog final : public PortListener {
 public:
  void on_up() override { calls.emplace_back("up"); }
  void on_data(ByteView) override { calls.emplace_back("data"); }
  void on_arrivals(ByteView, std::span<const std::size_t>) override { calls.emplace_back("arrivals"); }
  void on_drained() override { calls.emplace_back("drained"); }
  void on_down(const LineDown&) override { calls.emplace_back("down"); }
  void on_finished(int) override { calls.emplace_back("finished"); }
  void on_complete(int) override { calls.emplace_back("complete"); }
  Answers on_ended() override { return Answers::until_hang_up; }
  [[nodiscard]] bool half_closes() const override { return true; }
  bool wants_rest() override { return true; }
  [[nodiscard]] std::optional<std::size_t> unread() const override { return 8; }
  void on_interrupted(const LineDown&) override { calls.emplace_back("interrupted"); }
  void on_resumed() override { calls.emplace_back("resumed"); }
  void told(const LineEvent& event) override { calls.push_back("told " + std::to_string(event.index())); }
  std::vector<std::string> calls;
};

TEST(ForwardingPort, PassesOnEveryCallToTheListener) {
  std::vector<std::string> calls;
  auto inner = std::make_unique<ToldPort>(calls);
  ToldPort& port = *inner;
  Wrapper wrapper(std::move(inner));
  WholeLog log;
  wrapper.listen(log);
  PortListener& told = port.outer();
  told.on_up();
  told.on_data(as_bytes("x"));
  told.on_arrivals(as_bytes("x"), {});
  told.on_drained();
  told.on_down({});
  told.on_finished(0);
  told.on_complete(0);
  told.on_interrupted({});
  told.on_resumed();
  told.told(line::Flush{FlushQueue::both});
  told.told(LineSignal{});
  told.told(line::Dropped{1, "why"});
  EXPECT_EQ(log.calls,
            (std::vector<std::string>{"up", "data", "arrivals", "drained", "down", "finished", "complete",
                                      "interrupted", "resumed", "told 0", "told 2", "told 9"}));
  EXPECT_EQ(told.on_ended(), PortListener::Answers::until_hang_up);
  EXPECT_TRUE(told.half_closes());
  EXPECT_TRUE(told.wants_rest());
  EXPECT_EQ(told.unread(), 8U);
}

}  // namespace
}  // namespace porttape
