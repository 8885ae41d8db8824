#include "libport/port/recording_port.hpp"

#include <array>
#include <chrono>
#include <string_view>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

// How often a tape that cannot be made or written is tried again, or told of.
constexpr Nanos kRetry = std::chrono::seconds(1);

}  // namespace

RecordingPort::RecordingPort(const PortContext& context, std::unique_ptr<Port> inner, Options options)
    : context_(context), inner_(std::move(inner)), options_(std::move(options)), first_tape_(options_.tape) {}

void RecordingPort::listen(PortListener& listener) {
  Port::listen(listener);
  inner_->listen(*this);
}

Result<void> RecordingPort::prepare() {
  if (Result<void> free = TapeWriter::check(options_.tape, {.on_existing = options_.on_existing}); !free)
    return free;
  return inner_->prepare();
}

TapeTime RecordingPort::tape_time() const {
  return TapeTime{std::chrono::duration_cast<Micros>(options_.now() - zero_)};
}

void RecordingPort::open() {
  open_ = true;
  writing_ended_ = false;
  if (started_) {
    if (!tape_) start_tape();
    if (tape_) tape_->open_event(tape_time());
  } else {
    zero_ = options_.now();
    if (options_.on_existing != OnExisting::overwrite) begin_tape();
  }
  inner_->open();
}

// A tape that replaces another is made only when the line is up: a device that cannot be opened costs
// nothing.
void RecordingPort::on_up() {
  if (open_ && !started_) begin_tape();
  listener().on_up();
}

void RecordingPort::begin_tape() {
  start_tape();
  if (tape_) tape_->open_event(TapeTime{});
}

void RecordingPort::close() {
  inner_->close();
  if (open_ && tape_) tape_->close_event(tape_time());
  open_ = false;
}

void RecordingPort::write(ByteView data) {
  const TapeTime at = tape_time();  // before it goes out: the answer must not be stamped earlier
  inner_->write(data);
  if (!tape_) return missed(data.size());
  tape_->write_block(at, data);
  tell_of_failure();
}

std::size_t RecordingPort::write_some(ByteView data) {
  const TapeTime at = tape_time();
  const std::size_t sent = inner_->write_some(data);
  if (tape_) {
    tape_->write_block(at, data.first(sent));
    tell_of_failure();
  } else {
    missed(sent);
  }
  return sent;
}

bool RecordingPort::end_writing() {
  writing_ended_ = true;
  if (tape_) tape_->half_close_event(tape_time(), Side::driver);
  return inner_->end_writing();
}

void RecordingPort::note_gap(std::uint64_t bytes, std::string_view why) {
  if (tape_) tape_->gap_event(tape_time(), bytes, why);
}

bool RecordingPort::discard() {
  const bool dropped = inner_->discard();
  if (dropped && tape_) tape_->flush_event(tape_time(), "both");
  return dropped;
}

void RecordingPort::on_data(ByteView data) {
  const TapeTime at = tape_time();
  listener().on_data(data);
  if (!tape_) return missed(data.size());
  tape_->read_block(at, data);
  tell_of_failure();
}

void RecordingPort::on_down(const LineDown& down) {
  // A device that listens waits for its next peer, and the driver's line stays; one that ends when the driver
  // has ended has not left it.
  const bool left = !inner_->passive() && !(writing_ended_ && down.reason == LineDown::Reason::closed);
  if (tape_ && left) tape_->device_lost_event(tape_time(), down.error.message, true);
  listener().on_down(down);
}

PortListener::Answers RecordingPort::on_ended() {
  if (tape_) tape_->half_close_event(tape_time(), Side::device);
  return listener().on_ended();
}

void RecordingPort::on_interrupted(const LineDown& down) {
  if (tape_) tape_->device_lost_event(tape_time(), down.error.message, false);
  listener().on_interrupted(down);
}

void RecordingPort::on_resumed() {
  if (tape_) tape_->device_back_event(tape_time());
  listener().on_resumed();
}

void RecordingPort::on_dropped(std::uint64_t bytes, std::string_view why) {
  if (tape_) tape_->gap_event(tape_time(), bytes, why);
  listener().on_dropped(bytes, why);
}

// Bytes passed while the tape could not be made.
void RecordingPort::missed(std::size_t bytes) {
  if (!started_) return;  // no driver has come yet
  missed_bytes_ += bytes;
  if (options_.now() >= next_try_) start_tape();
}

void RecordingPort::start_tape() {
  started_ = true;
  next_try_ = options_.now() + kRetry;
  options_.header.zero = tape_zero(zero_, options_.now());
  Result<TapeWriter> tape = TapeWriter::create(
      options_.tape, options_.header, {.on_existing = options_.on_existing, .first_number = first_number_});
  if (tape) {
    tape_ = std::move(*tape);
    options_.tape = tape_->paths();
    next_try_ = {};
    context_.log->info("recording to {}", options_.tape.name());
    if (!missed_why_.empty()) tape_->gap_event(tape_time(), std::exchange(missed_bytes_, 0), missed_why_);
    missed_why_.clear();
    return;
  }
  incomplete_ = true;
  if (std::exchange(missed_why_, tape.error().message).empty()) {
    context_.log->error("{}; nothing is recorded until that is mended, the line stays up", missed_why_);
  }
  if (options_.fail_closed) listener().on_finished(exit_status::kRuntime);
}

void RecordingPort::end_tape() {
  if (missed_bytes_ > 0) {
    context_.log->error("{} bytes passed and are on no tape: {}", std::exchange(missed_bytes_, 0),
                        missed_why_);
  }
  if (!tape_) return;
  const Result<void> finished = tape_->finish(tape_time());
  if (!finished) {
    incomplete_ = true;
    context_.log->error("{}", finished.error().message);
  } else {
    context_.log->info("{} is complete: {} bytes", options_.tape.name(), tape_->bytes_written());
  }
  tape_.reset();
}

void RecordingPort::tell_of_failure() {
  if (tape_->failing() == failing_) return;
  failing_ = !failing_;
  if (!failing_) {
    if (std::exchange(failure_told_, false)) {
      context_.log->info("{} is being written again; {} bytes are missing", options_.tape.name(),
                         tape_->bytes_lost());
    }
    return;
  }
  // A nearly full disk takes one block and not the next.
  if (options_.now() < next_try_) return;
  next_try_ = options_.now() + kRetry;
  failure_told_ = true;
  context_.log->error(
      "tape {}: {}; {}", options_.tape.name(), tape_->failure(),
      options_.fail_closed ? "ending, as --fail-closed asks" : "the line stays up, the loss is counted");
  if (options_.fail_closed) listener().on_finished(exit_status::kRuntime);
}

void RecordingPort::rotate() {
  if (!started_) return;  // no driver yet, no tape
  if (tape_) options_.header.previous = PreviousTape{tape_->id(), options_.tape.file_name()};
  end_tape();
  options_.tape = first_tape_;
  options_.on_existing = OnExisting::next;
  first_number_ = 2;
  started_ = false;
  if (!open_) return;
  zero_ = options_.now();
  begin_tape();
}

void RecordingPort::peer_flushed(FlushQueue queue) {
  constexpr std::array<std::string_view, 3> names = {"in", "out", "both"};
  if (tape_) tape_->flush_event(tape_time(), names.at(static_cast<std::size_t>(queue)));
  inner_->peer_flushed(queue);
}

void RecordingPort::finish() {
  close();
  inner_->finish();
}

void RecordingPort::on_complete(int exit_status) {
  end_tape();
  listener().on_complete(exit_status != 0 ? exit_status : incomplete_ ? exit_status::kRuntime : 0);
}

}  // namespace porttape
