#include "libport/blocking/blocking_port.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <utility>

#include <spdlog/logger.h>

#include "libport/catalog/port_types.hpp"
#include "libport/port/context.hpp"
#include "libport/taped/replay_port.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

constexpr Nanos kFirstRetry = std::chrono::milliseconds(50);
constexpr Nanos kLongestRetry = std::chrono::seconds(2);
constexpr std::size_t kWriteChunk = std::size_t{64} * 1024;

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

Error usage_error(const char* what) { return make_error(Errc::usage, what); }

// What is left of a call's timeout.
class Remaining {
 public:
  Remaining(const Clock& clock, Micros timeout)
      : clock_(clock), timeout_(timeout), end_(clock.now() + timeout) {}
  [[nodiscard]] Micros operator()() const {
    if (timeout_ <= Micros{0}) return timeout_;
    return std::max(Micros{0}, std::chrono::ceil<Micros>(end_ - clock_.now()));
  }

 private:
  const Clock& clock_;
  Micros timeout_;
  Instant end_;
};

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
  for_each_arrival(data, ends, [this](ByteView arrival) { on_data(arrival); });
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

Result<void> BlockingPort::check_read() const {
  if (!open_ && input_.empty()) return usage_error("the port is not open");
  if (!can_read_) return usage_error("the port may not be read from");
  return {};
}

Result<void> BlockingPort::check_write() const {
  if (!open_) return usage_error("the port is not open");
  if (!can_write_) return usage_error("the port may not be written to");
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
  WaitingCalls* const calls = port_->waiting();
  const std::string awaited = calls == nullptr ? std::string() : calls->awaits();
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

std::size_t BlockingPort::write_some(ByteView data) {
  if (WaitingCalls* const calls = port_->waiting()) return calls->write_some(data);
  port_->write(data);
  return data.size();
}

std::size_t BlockingPort::unsent() {
  WaitingCalls* const calls = port_->waiting();
  return calls == nullptr ? 0 : calls->unsent();
}

Result<Transfer> BlockingPort::write(ByteView data) {
  if (Result<void> may = check_write(); !may) return may.error();
  if (port_->keeps_datagrams() && data.size() > Port::kLargestDatagram) {
    return make_error(Errc::usage, fmt::format("{} bytes do not fit a datagram, which holds at most {}",
                                               data.size(), Port::kLargestDatagram));
  }
  reopen();
  const Remaining left(loop_.clock(), timeout_);
  wait_.poll();
  std::size_t sent = 0;
  while (!down_ && !data.empty()) {
    if (up_ && !port_->congested()) {
      if (sent == data.size()) break;
      const ByteView rest = data.subspan(sent);
      const ByteView piece = port_->keeps_datagrams() ? rest : rest.first(std::min(rest.size(), kWriteChunk));
      drained_ = false;
      const std::size_t taken = write_some(piece);
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
  if (!open_) return usage_error("the port is not open");
  wait_.poll();
  if (!port_) return {};
  if (WaitingCalls* const calls = port_->waiting(); calls != nullptr && !calls->discard()) return {};
  input_.clear();
  consumed();
  return {};
}

Result<Transfer> BlockingPort::drain() {
  if (!open_) return usage_error("the port is not open");
  // The kernel does not tell when its queue is empty.
  const auto empty = [this] { return down_ || (!port_->congested() && unsent() == 0); };
  if (wait_.until_seen(empty, timeout_) != LoopWait::End::ready) return Transfer{0, Transfer::End::timed_out};
  if (!down_) return Transfer{};
  return Transfer{0, Transfer::End::closed};
}

bool BlockingPort::plays_tape() const { return spec_.get<ReplayPort::Options>() != nullptr; }

// What is asked for stands on the tape before what becomes of it.
Result<void> BlockingPort::set_line(unsigned baud) {
  const std::optional<LineSettings> now = port_->settings();
  if (!now && !plays_tape()) return make_error(Errc::usage, port_->name() + " has no baud rate");
  const SeenSettings known = now ? SeenSettings::of(*now) : SeenSettings{};
  const SeenSettings wanted = SeenSettings{.baud = baud}.over(known);
  if (open_) port_->peer_set(wanted, SettingsOrder::exact);
  return now ? port_->apply(wanted.over(*now)) : Result<void>();
}

Result<void> BlockingPort::set_baud(unsigned baud) {
  if (port_) {
    if (Result<void> set = set_line(baud); !set) return set;
  }
  if (plays_tape()) return {};
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
