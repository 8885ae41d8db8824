#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// A port that keeps a tape of the port it owns. Bytes are passed on first and written to the tape in the same
// turn of the loop, so that a killed process has lost at most the block it was in. The tape's zero is the
// first open(); its files come into being then.
class RecordingPort final : public Port, private PortListener {
 public:
  struct Options {
    TapePaths tape;
    TapeHeader header;
    OnExisting on_existing = OnExisting::refuse;
    bool fail_closed = false;  // end with status 1 when the tape cannot be written; else the line stays up
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
  bool discard() override;
  Result<void> set_baud(unsigned baud) override { return inner_->set_baud(baud); }
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

  [[nodiscard]] TapeTime tape_time() const;
  void begin_tape();
  void start_tape();
  void missed(std::size_t bytes);
  void end_tape();
  void tell_of_failure();

  PortContext context_;
  std::unique_ptr<Port> inner_;
  Options options_;
  TapePaths first_tape_;
  unsigned first_number_ = 1;  // of the names that the next tape may take
  std::optional<TapeWriter> tape_;
  Instant zero_{};
  bool open_ = false;
  bool writing_ended_ = false;  // in this session
  bool started_ = false;
  bool failing_ = false;
  bool failure_told_ = false;
  Instant next_try_{};
  std::uint64_t missed_bytes_ = 0;  // while the tape could not be made
  std::string missed_why_;
  bool incomplete_ = false;
};

}  // namespace porttape
