// The life of the line: creation, opening, loss, waiting. Reading and writing are in blocking_transfer.cpp.

#include "libport/blocking/blocking_port.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <utility>

#include "libport/catalog/port_types.hpp"
#include "libport/port/context.hpp"
#include "libport/taped/replay_port.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

constexpr Nanos kFirstRetry = std::chrono::milliseconds(50);
constexpr Nanos kLongestRetry = std::chrono::seconds(2);

// Goes on at the next open() where it was: a tape that is written or played.
bool has_tape(const PortSpec& spec) {
  return !spec.type().records.empty() || spec.get<ReplayPort::Options>() != nullptr;
}

Result<std::unique_ptr<BlockingPort>> made(const Result<PortSpec>& spec,
                                           std::shared_ptr<spdlog::logger> log) {
  if (!spec) return spec.error();
  return std::make_unique<BlockingPort>(*spec, std::move(log));
}

// With this program's defaults.
Result<PortSpec> typed(Result<PortOptions> written) {
  if (!written) return written.error();
  if (written->type->name == "logreader") set_replay_defaults(ReplayUse::in_process, written->values);
  return PortSpec::read(std::move(*written));
}

}  // namespace

Result<std::unique_ptr<BlockingPort>> BlockingPort::create(std::string_view spec,
                                                           std::shared_ptr<spdlog::logger> log) {
  return made(typed(parse_options(port_types(), spec)), std::move(log));
}

Result<std::unique_ptr<BlockingPort>> BlockingPort::create(std::map<std::string, std::string> options,
                                                           std::shared_ptr<spdlog::logger> log) {
  return made(typed(check_options(std::move(options))), std::move(log));
}

BlockingPort::BlockingPort(PortSpec spec, std::shared_ptr<spdlog::logger> log)
    : log_(log ? std::move(log) : std::make_shared<spdlog::logger>("porttape")),
      spec_(std::move(spec)),
      retry_(loop_,
             [this] {
               if (port_) port_->open();
             }),
      can_read_(spec_.common().reads),
      can_write_(spec_.common().writes),
      always_open_(spec_.common().always_open) {
  if (const auto timeout = spec_.common().timeout) timeout_ = std::chrono::round<Micros>(*timeout);
}

BlockingPort::~BlockingPort() { finish(); }

Result<void> BlockingPort::make() {
  if (port_) return {};
  // Opened again by this class; permissions are widened as far as the caller wants them now.
  spec_.common().always_open = false;
  spec_.common().reads |= can_read_;
  spec_.common().writes |= can_write_;
  Result<std::unique_ptr<Port>> port =
      make_port({.loop = &loop_, .log = log_, .pulled = true}, spec_, "in-process");
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
  if (wait_.until([this] { return came_up_ || down_; }, kForever) == LoopWait::End::stalled) {
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
  if (!has_tape(spec_)) {
    (void)complete();
  }
  wait_.poll();
}

// Finishes the port and lets it go.
int BlockingPort::complete() {
  if (!port_) return 0;
  complete_.reset();
  port_->finish();
  (void)wait_.until([this] { return complete_.has_value(); }, kForever);
  port_.reset();
  return complete_.value_or(exit_status::kRuntime);
}

int BlockingPort::finish() {
  close();
  const int status = complete();
  wait_.poll();
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
  wait_.progress();
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

Result<void> BlockingPort::set_baud(unsigned baud) {
  if (port_) {
    std::optional<LineSettings> settings = port_->settings();
    if (!settings) return make_error(Errc::usage, port_->name() + " has no baud rate");
    settings->baud = baud;
    if (Result<void> set = port_->apply(*settings); !set) return set;
  }
  // For the ports that later opens make.
  PortOptions written = spec_.written();
  written.values["baud"] = std::to_string(baud);
  Result<PortSpec> changed = typed(check_options(std::move(written)));
  if (!changed) return changed.error();
  changed->common() = spec_.common();
  spec_ = std::move(*changed);
  return {};
}

std::string BlockingPort::status() const {
  const std::string waits = timeout_ < Micros{0}
                                ? "for ever"
                                : fmt::format("{:.6f} s", std::chrono::duration<double>(timeout_).count());
  const std::string_view state = !open_ ? "not open" : up_ ? "open" : down_ ? "down" : "being opened again";
  std::string out =
      fmt::format("{}\nState: {}\nTimeout: {}\nPermissions: {}{}{}\n", spec_.name(), state, waits,
                  can_read_ ? "read" : "", can_read_ && can_write_ ? ", " : "", can_write_ ? "write" : "");
  if (always_open_) out += "Always open\n";
  for (const auto& [option, value] : spec_.written().values) out += fmt::format("{}: {}\n", option, value);
  return out + fmt::format("Bytes read: {}, written: {}, waiting to be read: {}\n", read_bytes_,
                           written_bytes_, input_.size());
}

}  // namespace porttape
