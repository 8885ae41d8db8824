#pragma once

#include <string>
#include <utility>

#include "libport/port/port.hpp"

namespace porttape {

// A port that a test plays both ends of: what was written to it is in `written`, what its peer does is a
// call.
class MemoryPort final : public Port {
 public:
  // What the test looks at and steers; outlives the port.
  struct Peer {
    MemoryPort* port = nullptr;
    std::string written;
    std::string calls;  // "prepare open close …", as they came
    bool congested = false;
    bool reading = true;
    bool passive = false;
    bool up_at_once = true;  // open() brings the line up
    Result<void> prepared;
    int status = 0;

    void up() { port->listener().on_up(); }
    void send(std::string_view text) { port->listener().on_data(as_bytes(text)); }
    void drain() {
      congested = false;
      port->listener().on_drained();
    }
    void down(LineDown::Reason reason, std::string why = {}) {
      port->listener().on_down({.reason = reason, .error = make_error(Errc::device_lost, std::move(why))});
    }
    void finish(int exit_status) { port->listener().on_finished(exit_status); }
  };

  explicit MemoryPort(Peer& peer) : peer_(&peer) { peer.port = this; }

  Result<void> prepare() override {
    peer_->calls += "prepare ";
    return peer_->prepared;
  }
  void open() override {
    peer_->calls += "open ";
    if (peer_->up_at_once) listener().on_up();
  }
  void close() override { peer_->calls += "close "; }
  void write(ByteView data) override { peer_->written += as_text(data); }
  [[nodiscard]] bool congested() const override { return peer_->congested; }
  void set_reading(bool on) override { peer_->reading = on; }
  void hang_up(bool after_reading) override {
    peer_->calls += after_reading ? "hang_up_after_reading " : "hang_up ";
  }
  void rotate() override { peer_->calls += "rotate "; }
  int finish() override {
    peer_->calls += "finish ";
    return peer_->status;
  }
  [[nodiscard]] bool passive() const override { return peer_->passive; }
  [[nodiscard]] std::string name() const override { return "memory"; }

 private:
  Peer* peer_;
};

}  // namespace porttape
