#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/line/waiting_requests.hpp"
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
    int gap_notes = 0;                  // calls of it
    bool up_at_once = true;             // open() brings the line up
    std::optional<std::size_t> unread;  // what unread_by_peer() gives
    bool completes = true;              // finish() is answered at once
    std::function<void()> pending;      // what read_pending() does
    bool left = false;                  // what left_bytes() gives
    std::function<void()> on_open;      // what open() does besides
    Result<void> prepared;
    std::optional<LineSettings> settings;  // it is a serial line
    bool takes_settings = true;
    bool shows_signals = false;
    std::vector<std::function<void()>> drains;              // that the test ends
    std::vector<TakeAnswer> questions;                      // that the test answers
    std::vector<FlushQueue> flushes;                        // that it was told
    std::vector<SettingsOrder> orders;                      // of the settings that it was told
    std::vector<std::optional<std::uint64_t>> left_unread;  // that it was told
    std::vector<std::uint64_t> refused;                     // the same
    std::string gap_why;                                    // of the last note_gap()
    int status = 0;
    Result<void> requested;  // what it answers to a request

    WaitingRequests<std::function<void()>> waiting_drains;  // of the peer
    WaitingRequests<TakeAnswer> waiting_questions;

    void tell(const LineEvent& event) { port->listener().told(event); }
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
    void drop(std::uint64_t bytes) { tell(line::Dropped{bytes, "a test wants it"}); }
    void arrive(std::string_view text, std::vector<std::size_t> ends) {
      port->listener().on_arrivals(as_bytes(text), ends);
    }
    void leave_unread(std::uint64_t bytes) { tell(line::LeftUnread{bytes}); }
    void refuse(std::uint64_t bytes) { tell(line::Refused{bytes}); }
    void fault(const LineFault& fault) { tell(fault); }
    void flush(FlushQueue queue) { tell(line::Flush{queue}); }
    void set(const SeenSettings& seen, SettingsOrder order = SettingsOrder::exact) {
      tell(line::Settings{seen, order});
    }
    void signal(const LineSignal& signal) { tell(signal); }
    void wait_until_sent(std::function<void()> done) {
      tell(line::Drain{waiting_drains.keep(std::move(done))});
    }
    void ask(TakeAnswer done) { tell(line::Ask{waiting_questions.keep(std::move(done)), {}}); }
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
  [[nodiscard]] PortFacets facets() override { return {.recorder = this}; }
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
  void tell(const LineEvent& event) override {
    std::visit([this](const auto& each) { note(each); }, event);
  }
  void hang_up(bool after_reading) override {
    peer_->calls += after_reading ? "hang_up_after_reading " : "hang_up ";
  }
  void read_pending() override {
    if (peer_->pending) peer_->pending();
  }
  [[nodiscard]] bool left_bytes() const override { return peer_->left; }
  void finish() override {
    peer_->calls += "finish ";
    if (peer_->completes) listener().on_complete(peer_->status);
  }
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = peer_->passive,
            .keeps_datagrams = peer_->datagrams,
            .has_half_close = peer_->half_closes,
            .shows_signals = peer_->shows_signals};
  }
  [[nodiscard]] std::string name() const override { return peer_->name; }

 private:
  void note(const LineSignal& signal) {
    peer_->calls += std::string(name_of(signal.name)) + (signal.on ? "_on " : "_off ");
  }
  void note(const line::Mark& mark) { peer_->calls += "mark:" + mark.text + " "; }
  void note(const line::Drain& drain) {
    peer_->calls += "drain ";
    peer_->drains.push_back([this, drain] { listener().told(line::Sent{drain.number}); });
  }
  void note(const line::Ask& question) {
    peer_->calls += "ask ";
    peer_->questions.push_back([this, number = question.number](const std::optional<LineAnswer>& answer) {
      listener().told(line::Answer{number, answer});
    });
  }
  void note(const line::Sent& sent) {
    if (const auto done = peer_->waiting_drains.take(sent.number)) (*done)();
  }
  void note(const line::Answer& answer) {
    if (const auto done = peer_->waiting_questions.take(answer.number)) (*done)(answer.answer);
  }
  void note(const line::Flush& flush) {
    peer_->calls += "peer_flushed ";
    peer_->flushes.push_back(flush.queue);
  }
  void note(const line::Settings& settings) {
    peer_->calls += "peer_set ";
    peer_->orders.push_back(settings.order);
  }
  void note(const line::LeftUnread& left) { peer_->left_unread.push_back(left.bytes); }
  void note(const line::Refused& other) { peer_->refused.push_back(other.bytes); }
  void note(const line::Dropped&) {}
  void note(const LineFault&) {}
  void note(const line::WatchSignals& watch) {
    if (watch.on) peer_->calls += "watch_signals ";
  }

  Result<void> request(const RecorderRequest& what) override {
    peer_->calls += what.note ? "mark:" + std::get<line::Mark>(*what.note).text + " " : "next_tape ";
    return peer_->requested;
  }
  void note_gap(std::uint64_t bytes, std::string_view why) override {
    peer_->gaps += bytes;
    ++peer_->gap_notes;
    peer_->gap_why = why;
  }

  Peer* peer_;
};

}  // namespace porttape
