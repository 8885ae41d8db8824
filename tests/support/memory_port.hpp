#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/port/port.hpp"

namespace porttape {

// A port that a test plays both ends of: what was written to it is in `written`, what its peer does is a
// call.
class MemoryPort final : public Port, private Recorder {
 public:
  // What the test looks at and steers; outlives the port.
  struct Peer {
    MemoryPort* port = nullptr;
    std::string name = "memory";
    std::string written;
    int writes = 0;
    std::string calls;  // "prepare open close …", as they came
    bool congested = false;
    bool reading = true;
    bool passive = false;
    bool datagrams = false;
    bool half_closes = true;            // what end_writing() gives
    std::uint64_t gaps = 0;             // bytes of note_gap()
    bool up_at_once = true;             // open() brings the line up
    std::optional<std::size_t> unread;  // what unread_by_peer() gives
    bool completes = true;              // finish() is answered at once
    std::function<void()> pending;      // what read_pending() does
    std::function<void()> on_open;      // what open() does besides
    Result<void> prepared;
    std::optional<LineSettings> settings;  // it is a serial line
    bool takes_settings = true;
    bool shows_signals = false;
    std::vector<std::function<void()>> drains;  // that the test ends
    std::vector<TakeAnswer> questions;          // that the test answers
    std::vector<FlushQueue> flushes;            // of peer_flushed()
    std::vector<SettingsOrder> orders;          // of peer_set()
    std::vector<std::uint64_t> left_unread;     // of peer_left_unread()
    std::vector<std::uint64_t> refused;         // of peer_refused()
    std::string gap_why;                        // of the last note_gap()
    int status = 0;
    Result<void> requested;  // what it answers to a request

    void up() { port->listener().on_up(); }
    void send(std::string_view text) { port->listener().on_data(as_bytes(text)); }
    void drain() {
      congested = false;
      port->listener().on_drained();
    }
    void down(LineDown::Reason reason, std::string why = {}) {
      port->listener().on_down({.reason = reason, .error = make_error(Errc::device_lost, std::move(why))});
    }
    void hang_up(bool after_reading) {
      port->listener().on_down(
          {.reason = LineDown::Reason::hung_up, .error = {}, .after_reading = after_reading});
    }
    [[nodiscard]] std::optional<std::size_t> unread_by_driver() const { return port->listener().unread(); }
    PortListener::Answers end() { return port->listener().on_ended(); }
    [[nodiscard]] bool other_half_closes() const { return port->listener().half_closes(); }
    bool wants_rest() { return port->listener().wants_rest(); }
    void interrupt() { port->listener().on_interrupted({.reason = LineDown::Reason::lost, .error = {}}); }
    void resume() { port->listener().on_resumed(); }
    void drop(std::uint64_t bytes) { port->listener().on_dropped(bytes, "a test wants it"); }
    void arrive(std::string_view text, std::vector<std::size_t> ends) {
      port->listener().on_arrivals(as_bytes(text), ends);
    }
    void leave_unread(std::uint64_t bytes) { port->listener().on_left_unread(bytes); }
    void refuse(std::uint64_t bytes) { port->listener().on_refused(bytes); }
    void fault(const LineFault& fault) { port->listener().on_fault(fault); }
    void flush(FlushQueue queue) { port->listener().on_flush(queue); }
    void set(const SeenSettings& seen, SettingsOrder order = SettingsOrder::exact) {
      port->listener().on_settings(seen, order);
    }
    void signal(const LineSignal& signal) { port->listener().on_signal(signal); }
    void wait_until_sent(std::function<void()> done) { port->listener().on_drain(std::move(done)); }
    void ask(TakeAnswer done) { port->listener().on_ask({}, std::move(done)); }
    void finish(int exit_status) { port->listener().on_finished(exit_status); }
    void complete() { port->listener().on_complete(status); }
  };

  explicit MemoryPort(Peer& peer) : peer_(&peer) { peer.port = this; }

  Result<void> prepare() override {
    peer_->calls += "prepare ";
    return peer_->prepared;
  }
  void open() override {
    peer_->calls += "open ";
    if (peer_->on_open) peer_->on_open();
    if (peer_->up_at_once) listener().on_up();
  }
  void close() override {
    peer_->calls += "close ";
    peer_->congested = false;  // what was queued is dropped
  }
  void write(ByteView data) override {
    peer_->written += as_text(data);
    ++peer_->writes;
  }
  bool end_writing() override {
    peer_->calls += "end_writing ";
    return peer_->half_closes;
  }
  [[nodiscard]] bool has_half_close() const override { return peer_->half_closes; }
  [[nodiscard]] Recorder* recorder() override { return this; }
  [[nodiscard]] bool keeps_datagrams() const override { return peer_->datagrams; }
  [[nodiscard]] bool congested() const override { return peer_->congested; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return peer_->unread; }
  void set_reading(bool on) override { peer_->reading = on; }
  [[nodiscard]] std::optional<LineSettings> settings() const override { return peer_->settings; }
  Result<void> apply(const LineSettings& settings) override {
    peer_->calls += "apply ";
    if (!peer_->takes_settings) return make_error(Errc::io, "no such rate");
    peer_->settings = settings;
    return {};
  }
  void signal(const LineSignal& signal) override {
    peer_->calls += std::string(name_of(signal.name)) + (signal.on ? "_on " : "_off ");
  }
  void watch_signals(bool on) override {
    if (on) peer_->calls += "watch_signals ";
  }
  [[nodiscard]] bool shows_signals() const override { return peer_->shows_signals; }
  void drain(std::function<void()> done) override {
    peer_->calls += "drain ";
    peer_->drains.push_back(std::move(done));
  }
  void ask(const LineRequest&, TakeAnswer done) override {
    peer_->calls += "ask ";
    peer_->questions.push_back(std::move(done));
  }
  void hang_up(bool after_reading) override {
    peer_->calls += after_reading ? "hang_up_after_reading " : "hang_up ";
  }
  void read_pending() override {
    if (peer_->pending) peer_->pending();
  }
  void peer_flushed(FlushQueue queue) override {
    peer_->calls += "peer_flushed ";
    peer_->flushes.push_back(queue);
  }
  void peer_set(const SeenSettings&, SettingsOrder order) override {
    peer_->calls += "peer_set ";
    peer_->orders.push_back(order);
  }
  void peer_left_unread(std::uint64_t bytes) override { peer_->left_unread.push_back(bytes); }
  void peer_refused(std::uint64_t bytes) override { peer_->refused.push_back(bytes); }
  void finish() override {
    peer_->calls += "finish ";
    if (peer_->completes) listener().on_complete(peer_->status);
  }
  [[nodiscard]] bool passive() const override { return peer_->passive; }
  [[nodiscard]] std::string name() const override { return peer_->name; }

 private:
  Result<void> request(const RecorderRequest& what) override {
    peer_->calls += what.kind == RecorderRequest::Kind::mark ? "mark:" + what.text + " " : "next_tape ";
    return peer_->requested;
  }
  void note_gap(std::uint64_t bytes, std::string_view why) override {
    peer_->gaps += bytes;
    peer_->gap_why = why;
  }

  Peer* peer_;
};

}  // namespace porttape
