// Reading and writing of a BlockingPort.

#include <algorithm>
#include <chrono>
#include <fmt/format.h>

#include "libport/blocking/blocking_port.hpp"

namespace porttape {
namespace {

constexpr std::size_t kWriteChunk = std::size_t{64} * 1024;

Error usage(const char* what) { return make_error(Errc::usage, what); }

// What is left of a call's timeout.
class Remaining {
 public:
  explicit Remaining(Micros timeout) : timeout_(timeout), end_(Loop::now() + timeout) {}
  [[nodiscard]] Micros operator()() const {
    if (timeout_ <= Micros{0}) return timeout_;
    return std::max(Micros{0}, std::chrono::ceil<Micros>(end_ - Loop::now()));
  }

 private:
  Micros timeout_;
  Instant end_;
};

}  // namespace

Result<void> BlockingPort::check_read() const {
  if (!open_ && input_.empty()) return usage("the port is not open");
  if (!can_read_) return usage("the port may not be read from");
  return {};
}

Result<void> BlockingPort::check_write() const {
  if (!open_) return usage("the port is not open");
  if (!can_write_) return usage("the port may not be written to");
  return {};
}

Result<Transfer> BlockingPort::wait_for_input(const Condition& enough, std::size_t room, Micros timeout) {
  if (Result<void> may = check_read(); !may) return may.error();
  if (enough()) return Transfer{};
  reopen();
  input_limit_ = std::max(kInputLimit, room);
  consumed();
  const LoopWait::End end =
      wait_.until_or_quiet([&] { return enough() || down_ || ended_ || !open_; }, timeout);
  input_limit_ = kInputLimit;
  if (enough()) return Transfer{};
  if (down_ && down_->error.code == Errc::damaged_tape) {
    Error error = down_->error;
    line_ended();
    return error;
  }
  if (down_ || ended_) return line_ended();
  if (!open_) return Transfer{0, Transfer::End::closed};
  if (end == LoopWait::End::timed_out) return Transfer{0, Transfer::End::timed_out};
  const std::string awaited = port_->awaits();
  if (awaited.empty()) return line_ended();  // a tape at its end
  return make_error(Errc::io, "reading would wait for ever: " + awaited);
}

Transfer BlockingPort::line_ended() {
  if (!open_) return {0, Transfer::End::closed};
  if (always_open_) {
    reopen_owed_ = true;
    down_.reset();
    up_ = ended_ = false;
    port_->close();
    if (input_.empty()) reopen();
  } else {
    open_ = false;
    release();
  }
  return {0, Transfer::End::closed};
}

Transfer BlockingPort::take(std::size_t count, std::span<Byte> into) {
  std::copy_n(input_.view().begin(), count, into.begin());
  input_.consume(count);
  read_bytes_ += count;
  if (input_.empty()) reopen();
  consumed();
  return {count};
}

void BlockingPort::consumed() {
  if (reading_ || input_.size() >= input_limit_ || !port_) return;
  reading_ = true;
  port_->set_reading(true);
}

Result<Transfer> BlockingPort::read(std::span<Byte> into) {
  if (input_.size() < into.size() && open_) wait_.poll();
  const Result<Transfer> waited =
      wait_for_input([&] { return !input_.empty() || into.empty(); }, into.size(), timeout_);
  if (!waited || !waited->done()) return waited;
  return take(std::min(input_.front_size(), into.size()), into);
}

Result<Transfer> BlockingPort::read_string(std::string& into) {
  if (open_) wait_.poll();
  const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout_);
  if (!waited || !waited->done()) return waited;
  into.assign(as_text(input_.view().first(input_.front_size())));
  return take(into.size(), {reinterpret_cast<Byte*>(into.data()), into.size()});
}

Result<Transfer> BlockingPort::read_full(std::span<Byte> into) {
  const Result<Transfer> waited =
      wait_for_input([&] { return input_.size() >= into.size(); }, into.size(), kForever);
  if (!waited || !waited->done()) return waited;
  return take(into.size(), into);
}

Result<Transfer> BlockingPort::read_until(std::span<Byte> into, Byte end) {
  std::size_t searched = 0;
  std::optional<std::size_t> found;
  const auto enough = [&] {
    if (!found) found = input_.find(end, searched);
    searched = input_.size();
    return found || input_.size() >= into.size();
  };
  const Result<Transfer> waited = wait_for_input(enough, into.size(), timeout_);
  if (!waited || !waited->done()) return waited;
  return take(std::min(found ? *found + 1 : into.size(), into.size()), into);
}

Result<Transfer> BlockingPort::read_string_until(std::string& into, char end) {
  std::size_t searched = 0;
  std::optional<std::size_t> found;
  const auto enough = [&] {
    if (!found) found = input_.find(static_cast<Byte>(end), searched);
    searched = input_.size();
    return found || input_.size() >= kLongestLine;
  };
  const Result<Transfer> waited = wait_for_input(enough, kLongestLine, timeout_);
  if (!waited || !waited->done()) return waited;
  if (!found) return make_error(Errc::io, fmt::format("no end of line in {} bytes", kLongestLine));
  into.resize(*found + 1);
  return take(into.size(), {reinterpret_cast<Byte*>(into.data()), into.size()});
}

Result<Transfer> BlockingPort::skip(std::size_t count) {
  std::size_t skipped = 0;
  while (skipped < count) {
    const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout_);
    if (!waited || !waited->done()) return waited;
    const std::size_t piece = std::min(input_.size(), count - skipped);
    input_.consume(piece);
    skipped += piece;
  }
  read_bytes_ += skipped;
  consumed();
  return Transfer{skipped};
}

Result<Transfer> BlockingPort::skip_until(Byte end, unsigned times) {
  std::size_t skipped = 0;
  while (times > 0) {
    const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout_);
    if (!waited || !waited->done()) return waited;
    const std::optional<std::size_t> found = input_.find(end);
    const std::size_t piece = found ? *found + 1 : input_.size();
    input_.consume(piece);
    skipped += piece;
    if (found) --times;
  }
  read_bytes_ += skipped;
  consumed();
  return Transfer{skipped};
}

Result<std::size_t> BlockingPort::bytes_available() {
  if (Result<void> may = check_read(); !may) return may.error();
  wait_.poll();
  return input_.front_size();
}

Result<Transfer> BlockingPort::bytes_available_wait() {
  if (open_) wait_.poll();
  const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout_);
  if (!waited || !waited->done()) return waited;
  return Transfer{input_.front_size()};
}

Error BlockingPort::broken() const {
  if (!down_->error.message.empty()) return down_->error;
  return make_error(Errc::device_lost, port_->name() + ": the line is down");
}

Result<Transfer> BlockingPort::write(ByteView data) {
  if (Result<void> may = check_write(); !may) return may.error();
  if (port_->keeps_datagrams() && data.size() > Port::kLargestDatagram) {
    return make_error(Errc::usage, fmt::format("{} bytes do not fit a datagram, which holds at most {}",
                                               data.size(), Port::kLargestDatagram));
  }
  reopen();
  const Remaining left(timeout_);
  wait_.poll();
  std::size_t sent = 0;
  while (!down_ && !data.empty()) {
    if (up_ && !port_->congested()) {
      if (sent == data.size()) break;
      const ByteView rest = data.subspan(sent);
      const ByteView piece = port_->keeps_datagrams() ? rest : rest.first(std::min(rest.size(), kWriteChunk));
      drained_ = false;
      const std::size_t taken = port_->write_some(piece);
      sent += taken;
      if (taken == piece.size()) continue;
    }
    const auto can_go_on = [&] { return down_ || (up_ && drained_ && !port_->congested()); };
    if (wait_.until(can_go_on, left()) != LoopWait::End::ready) break;
  }
  wait_.poll();  // a line that broke while it took the bytes
  written_bytes_ += sent;
  if (!down_) return sent > 0 || data.empty() ? Transfer{sent} : Transfer{0, Transfer::End::timed_out};
  if (sent == data.size() && down_->after_reading)
    return Transfer{sent};  // an orderly end, after these bytes
  const bool refused = down_->reason == LineDown::Reason::hung_up && !down_->error.message.empty();
  const Error error = broken();
  line_ended();
  if (open_ && !refused) return Transfer{sent, Transfer::End::closed};
  return error;
}

Result<Transfer> BlockingPort::write_full(ByteView data) {
  std::size_t sent = 0;
  while (sent < data.size()) {
    const Result<Transfer> step = write(data.subspan(sent));
    if (!step || step->end == Transfer::End::closed) return step;
    sent += step->bytes;
    if (step->done()) continue;
    return make_error(
        Errc::io, fmt::format("the peer took no byte within the timeout; {} of {} bytes are written", sent,
                              data.size()));
  }
  return Transfer{sent};
}

Result<void> BlockingPort::flush() {
  if (!open_) return usage("the port is not open");
  wait_.poll();
  if (!port_ || !port_->discard()) return {};
  input_.clear();
  consumed();
  return {};
}

Result<Transfer> BlockingPort::drain() {
  if (!open_) return usage("the port is not open");
  // The kernel does not tell when its queue is empty.
  const auto empty = [this] { return down_ || (!port_->congested() && port_->unsent() == 0); };
  if (wait_.until_seen(empty, timeout_) != LoopWait::End::ready) return Transfer{0, Transfer::End::timed_out};
  if (!down_) return Transfer{};
  return Transfer{0, Transfer::End::closed};
}

}  // namespace porttape
