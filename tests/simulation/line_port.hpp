#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "libport/base/end_wait.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/port.hpp"
#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// The near end: what a pty's, a tty's or a socket's port does, without the system.
class LinePort final : public Port {
 public:
  LinePort(World& world, Line& line);
  ~LinePort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_->to_far_.bytes() > line_->kind_.capacity; }
  bool end_writing() override;
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  [[nodiscard]] std::optional<LineSettings> settings() const override;
  Result<void> apply(const LineSettings& settings) override;
  void tell(const LineEvent& event) override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] bool left_bytes() const override { return up_ && !line_->open_ && line_->unsent() > 0; }
  void finish() override;
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = line_->kind_.passive,
            .keeps_datagrams = line_->kind_.datagrams,
            .has_half_close = line_->kind_.half_closes,
            .shows_signals = line_->kind_.supervised};
  }
  [[nodiscard]] std::string name() const override { return line_->name_; }

 private:
  friend class Line;
  void tell_signal(const LineSignal& signal);
  void tell_drain(const line::Drain& drain);
  void tell_question(const line::Ask& question);
  void tell_flush(FlushQueue queue);
  void tell_settings(const line::Settings& settings);
  void soon();
  void look();
  void deliver(std::size_t most);
  void deliver_datagrams(std::size_t most);
  bool deliver_act();
  void deliver_between();
  void tell_act(const Passed& act);
  void tell_signals();
  void come_up();
  void leave();
  void make(const LineSettings& settings);
  void interrupt();
  void resume();
  [[nodiscard]] LineDown down(LineDown::Reason reason, bool after_reading = false) const;
  void go_down(LineDown::Reason reason, bool after_reading = false);
  void drop_unsent();
  void reached(const Passed& act);
  void answer_all();
  void log(Passed what);
  void log_device(Passed::What what);
  void log(Passed::What what, bool to_listener) { log({.to_listener = to_listener, .what = what}); }

  World* world_;
  Line* line_;
  Timer timer_;
  bool prepared_ = false;
  bool accepting_ = false;
  bool up_ = false;
  bool interrupted_ = false;
  bool reading_ = true;
  bool watching_ = false;  // the signals of a device
  bool leaving_ = false;   // hang_up(true), and bytes are unread
  bool asked_ = false;     // on_ended was told
  bool was_congested_ = false;
  std::optional<EndWait> rest_wait_;
  std::optional<PortListener::Answers> answers_;
  std::optional<LineSettings> untried_;                    // given while the line was not up
  std::optional<LineSettings> asked_for_;                  // the last, and the device has them not yet
  std::map<std::uint64_t, std::function<void()>> drains_;  // of the near end: its device's
  std::map<std::uint64_t, TakeAnswer> questions_;
  Instant quiet_since_{};
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

}  // namespace porttape::simulation
