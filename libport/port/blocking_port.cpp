// The life of the line: creation, opening, loss, waiting. Reading and writing are in blocking_transfer.cpp.

#include "libport/port/blocking_port.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <utility>

#include "libport/port/context.hpp"
#include "libport/port/port_factory.hpp"

namespace porttape {
namespace {

constexpr Nanos kFirstRetry = std::chrono::milliseconds(50);
constexpr Nanos kLongestRetry = std::chrono::seconds(2);
constexpr Nanos kLongestPulse = std::chrono::milliseconds(5);

bool has_tape(const PortOptions& options) {
  return options.type == "logreader" || options.type.ends_with("log");
}

}  // namespace

Result<std::unique_ptr<BlockingPort>> BlockingPort::create(std::string_view spec,
                                                           std::shared_ptr<spdlog::logger> log) {
  Result<PortOptions> options = parse_port(spec);
  if (!options) return options.error();
  return std::make_unique<BlockingPort>(std::move(*options), std::move(log));
}

Result<std::unique_ptr<BlockingPort>> BlockingPort::create(std::map<std::string, std::string> options,
                                                           std::shared_ptr<spdlog::logger> log) {
  PortOptions named;
  if (auto type = options.extract("type")) named.type = std::move(type.mapped());
  named.values = std::move(options);
  Result<PortOptions> checked = check_port(std::move(named));
  if (!checked) return checked.error();
  return std::make_unique<BlockingPort>(std::move(*checked), std::move(log));
}

BlockingPort::BlockingPort(PortOptions options, std::shared_ptr<spdlog::logger> log)
    : log_(log ? std::move(log) : std::make_shared<spdlog::logger>("porttape")),
      options_(std::move(options)),
      limit_(loop_, [this] { timed_out_ = true; }),
      pulse_(loop_,
             [this] {
               pulse_every_ = std::min(pulse_every_ * 2, kLongestPulse);
               pulse_.set_after(pulse_every_);
             }),
      retry_(loop_,
             [this] {
               if (port_) port_->open();
             }),
      can_read_(!options_.flag("writeonly")),
      can_write_(!options_.flag("readonly")),
      always_open_(options_.values.erase("alwaysopen") > 0) {
  const double seconds = options_.number("timeout");
  if (seconds >= 0) timeout_ = Micros(std::llround(seconds * 1e6));
  if (options_.type == "logreader") options_.values.try_emplace("on-mismatch", "fail");
}

BlockingPort::~BlockingPort() { finish(); }

Result<void> BlockingPort::make() {
  if (port_) return {};
  if (can_read_) options_.values.erase("writeonly");
  if (can_write_) options_.values.erase("readonly");
  Result<std::unique_ptr<Port>> port =
      make_port({.loop = &loop_, .log = log_, .pulled = true}, options_, "in-process");
  if (!port) return port.error();
  (*port)->listen(*this);
  if (Result<void> ready = (*port)->prepare(); !ready) return ready;
  port_ = std::move(*port);
  return {};
}

Result<void> BlockingPort::open() {
  if (open_) return make_error(Errc::usage, "the port is already open");
  input_.clear();
  down_.reset();
  up_ = came_up_ = ended_ = reopen_owed_ = false;
  reading_ = true;
  if (Result<void> made = make(); !made) return made;
  port_->set_reading(true);
  port_->open();
  if (wait([this] { return came_up_ || down_; }, kForever) == Wake::stalled) {
    Error error = make_error(Errc::io, port_->name() + " does not come up");
    release();
    return error;
  }
  if (!came_up_) {  // a line may also be up and down again by now
    const Error error = down_->error;
    release();
    return error;
  }
  open_ = true;
  return {};
}

void BlockingPort::close() {
  open_ = false;
  input_.clear();
  release();
}

// Ports with a tape go on with it at the next open(); the others let go of all they have.
void BlockingPort::release() {
  retry_.cancel();
  up_ = false;
  if (!port_) return;
  port_->close();
  if (!has_tape(options_)) {
    (void)complete();
  }
  poll();
}

// Finishes the port and lets it go.
int BlockingPort::complete() {
  if (!port_) return 0;
  complete_.reset();
  port_->finish();
  (void)wait([this] { return complete_.has_value(); }, kForever);
  port_.reset();
  return complete_.value_or(exit_status::kRuntime);
}

int BlockingPort::finish() {
  close();
  const int status = complete();
  poll();
  return status;
}

void BlockingPort::on_up() {
  up_ = came_up_ = true;
  ended_ = false;
  drained_ = true;
  retry_after_ = kFirstRetry;
}

void BlockingPort::on_data(ByteView data) {
  if (!can_read_) return;
  input_.append(data, port_->keeps_datagrams());
  if (quiet_limit_ > Nanos{0}) limit_.set_after(quiet_limit_);
  if (reading_ && input_.size() >= input_limit_) {
    reading_ = false;
    port_->set_reading(false);
  }
}

void BlockingPort::on_arrivals(ByteView data, std::span<const std::size_t> ends) {
  if (!port_->keeps_datagrams()) return on_data(data);
  std::size_t begin = 0;
  for (const std::size_t end : ends) {
    on_data(data.subspan(begin, end - begin));
    begin = end;
  }
}

void BlockingPort::on_down(const LineDown& down) {
  up_ = false;
  drained_ = true;
  if (open_ && always_open_ && down.reason == LineDown::Reason::failed) {
    retry_.set_after(retry_after_);
    retry_after_ = std::min(retry_after_ * 2, kLongestRetry);
    return;
  }
  down_ = down;
  // The next peer's bytes must not join this one's: it is taken when the caller has seen the end.
  if (port_->passive()) port_->close();
}

PortListener::Answers BlockingPort::on_ended() {
  ended_ = true;
  return Answers::until_hang_up;
}

// The tape is used up, or cannot be written and must not fail: the end of the line.
void BlockingPort::on_finished(int exit_status) {
  if (down_) return;
  LineDown down;
  if (exit_status == exit_status::kRuntime) {
    down.reason = LineDown::Reason::lost;
    down.error = make_error(Errc::io, "the tape of " + port_->name() + " fails");
  }
  on_down(down);
}

// The new line's bytes must not join what is left of the old one's.
void BlockingPort::reopen() {
  if (!std::exchange(reopen_owed_, false)) return;
  input_.clear();
  retry_after_ = kFirstRetry;
  retry_.set_after(Nanos{0});
}

void BlockingPort::poll() {
  loop_.restart();
  while (loop_.poll_one()) {
  }
}

BlockingPort::Wake BlockingPort::wait(const Condition& ready, Micros timeout) {
  poll();
  if (ready()) return Wake::ready;
  if (timeout == Micros{0}) return Wake::timed_out;
  timed_out_ = false;
  if (timeout > Micros{0}) limit_.set_after(timeout);
  Wake wake = Wake::ready;
  loop_.restart();
  while (wake == Wake::ready && !ready()) {
    if (timed_out_) {
      wake = Wake::timed_out;
    } else if (!loop_.run_one()) {
      wake = Wake::stalled;
    }
  }
  limit_.cancel();
  return wake;
}

Result<void> BlockingPort::set_baud(unsigned baud) {
  if (port_) {
    if (Result<void> set = port_->set_baud(baud); !set) return set;
  }
  options_.values["baud"] = std::to_string(baud);
  return {};
}

std::string BlockingPort::status() const {
  const std::string waits = timeout_ < Micros{0}
                                ? "for ever"
                                : fmt::format("{:.6f} s", std::chrono::duration<double>(timeout_).count());
  const std::string_view state = !open_ ? "not open" : up_ ? "open" : down_ ? "down" : "being opened again";
  std::string out =
      fmt::format("{}\nState: {}\nTimeout: {}\nPermissions: {}{}{}\n", options_.name(), state, waits,
                  can_read_ ? "read" : "", can_read_ && can_write_ ? ", " : "", can_write_ ? "write" : "");
  if (always_open_) out += "Always open\n";
  for (const auto& [option, value] : options_.values) out += fmt::format("{}: {}\n", option, value);
  return out + fmt::format("Bytes read: {}, written: {}, waiting to be read: {}\n", read_bytes_,
                           written_bytes_, input_.size());
}

}  // namespace porttape
