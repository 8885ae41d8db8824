#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/taped/tape_keeper.hpp"

namespace porttape {

// A port that keeps a tape of the port it owns. Bytes are passed on first and given to the tape in the same
// turn of the loop, so that a killed process has lost at most the block it was in (LiveTape has the
// exceptions). The tape's zero is the first open(); its files come into being then.
class RecordingPort final : public Port, private PortListener {
 public:
  struct Options {
    TapeKeeper::Options tape;
    Instant (*now)() = &Loop::now;
  };

  RecordingPort(const PortContext& context, std::unique_ptr<Port> inner, Options options);

  void listen(PortListener& listener) override;
  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return inner_->congested(); }
  bool end_writing() override;
  void note_gap(std::uint64_t bytes, std::string_view why) override;
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() const override { return inner_->unsent(); }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override {
    return inner_->unread_by_peer();
  }
  bool discard() override;
  [[nodiscard]] std::optional<LineSettings> settings() const override { return inner_->settings(); }
  Result<void> apply(const LineSettings& settings) override { return inner_->apply(settings); }
  void set_reading(bool on) override { inner_->set_reading(on); }
  void hang_up(bool after_reading) override { inner_->hang_up(after_reading); }
  void read_pending() override { inner_->read_pending(); }
  void rotate() override;
  void peer_flushed(FlushQueue queue) override;
  void finish() override;
  [[nodiscard]] bool passive() const override { return inner_->passive(); }
  [[nodiscard]] bool keeps_datagrams() const override { return inner_->keeps_datagrams(); }
  [[nodiscard]] std::string name() const override { return inner_->name(); }

 private:
  void on_up() override;
  void on_data(ByteView data) override;
  void on_drained() override { listener().on_drained(); }
  void on_down(const LineDown& down) override;
  void on_finished(int exit_status) override { listener().on_finished(exit_status); }
  void on_complete(int exit_status) override;
  void on_flush(FlushQueue queue) override { listener().on_flush(queue); }
  Answers on_ended() override;
  bool wants_rest() override { return listener().wants_rest(); }
  void on_interrupted(const LineDown& down) override;
  void on_resumed() override;
  void on_dropped(std::uint64_t bytes, std::string_view why) override;

  void begin_tape();
  void note_flush(FlushQueue queue);
  void note_lost(const LineDown& down, bool hung_up);

  std::unique_ptr<Port> inner_;
  bool replaces_;  // the tape of that name
  Instant (*now_)();
  TapeKeeper keeper_;
  Instant zero_{};  // of the first open()
  bool open_ = false;
  bool writing_ended_ = false;  // in this session
};

}  // namespace porttape
