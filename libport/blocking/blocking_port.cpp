#include "libport/blocking/blocking_port.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <utility>

#include <spdlog/logger.h>

#include "libport/catalog/port_types.hpp"
#include "libport/port/context.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

constexpr Nanos kFirstRetry = std::chrono::milliseconds(50);
constexpr Nanos kLongestRetry = std::chrono::seconds(2);
constexpr std::size_t kWriteChunk = std::size_t{64} * 1024;

// Goes on at the next open() where it was: a tape that is written or played.
bool has_tape(const PortSpec& spec) {
  return !spec.type().records.empty() || spec.get<ReplayOptions>() != nullptr;
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

// Unlike std::thread::id, the number of a thread that has ended is not used again.
std::uint64_t number_of_this_thread() {
  static std::atomic<std::uint64_t> last = 0;
  thread_local const std::uint64_t number = ++last;
  return number;
}

// Finds the first such byte in the input while it grows; looks at each byte once. Begins again where other
// calls have taken bytes away.
class Search {
 public:
  Search(const InputBuffer& input, Byte wanted) : input_(input), wanted_(wanted) {}
  std::optional<std::size_t> operator()() {
    if (std::exchange(removed_, input_.removed()) != input_.removed()) {
      searched_ = 0;
      found_.reset();
    }
    if (!found_) found_ = input_.find(wanted_, searched_);
    searched_ = input_.size();
    return found_;
  }

 private:
  const InputBuffer& input_;
  Byte wanted_;
  std::uint64_t removed_ = input_.removed();
  std::size_t searched_ = 0;
  std::optional<std::size_t> found_;
};

// True while a scope runs, which may wait or throw.
class During {
 public:
  explicit During(bool& flag) : flag_(flag) { flag_ = true; }
  ~During() { flag_ = false; }
  During(const During&) = delete;
  During& operator=(const During&) = delete;

 private:
  bool& flag_;
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
  const LoopWait::Call call(wait_);
  if (completing_) (void)wait_.until([this] { return !completing_; }, kForever);
  if (open_) return usage_error("the port is already open");
  if (opening_) return usage_error("the port is being opened");
  const std::uint64_t line = ++line_;
  writer_ = number_of_this_thread();
  input_.clear();
  down_.reset();
  up_ = came_up_ = ended_ = reopen_owed_ = false;
  reading_ = true;
  if (Result<void> made = make(); !made) return made;
  port_->set_reading(true);
  const During opening(opening_);
  port_->open();
  const LoopWait::End end = wait_.until([&] { return came_up_ || down_ || line_ != line; }, kForever);
  if (line_ != line) return usage_error("the port was closed while it was being opened");
  if (end == LoopWait::End::stalled) {
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
  const LoopWait::Call call(wait_);
  close_line();
}

void BlockingPort::close_line() {
  open_ = false;
  input_.clear();
  release();
}

// Ports with a tape go on with it at the next open(); the others let go of all they have. What other threads
// wait for on this line is over.
void BlockingPort::release() {
  ++line_;
  retry_.cancel();
  up_ = false;
  if (!port_) return;
  if (!completing_) port_->close();
  if (!has_tape(spec_)) {
    (void)complete();
  }
  wait_.poll();
}

// Finishes the port and lets it go. Where another thread does that, waits until it is done.
int BlockingPort::complete() {
  if (completing_) (void)wait_.until([this] { return !completing_; }, kForever);
  if (!port_) return 0;
  const During completing(completing_);
  complete_.reset();
  port_->finish();
  (void)wait_.until([this] { return complete_.has_value(); }, kForever);
  port_.reset();
  return complete_.value_or(exit_status::kRuntime);
}

int BlockingPort::finish() {
  const LoopWait::Call call(wait_);
  close_line();
  const int status = complete();
  wait_.poll();
  return status;
}

bool BlockingPort::readable() const {
  if (open_) return true;
  const LoopWait::Call call(wait_);
  return !input_.empty();
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

// The port may keep as much as the largest of the reads that wait.
class BlockingPort::Room {
 public:
  Room(BlockingPort& port, std::size_t room) : port_(port) {
    ++port_.waiting_reads_;
    port_.input_limit_ = std::max(port_.input_limit_, room);
    port_.consumed();
  }
  ~Room() {
    if (--port_.waiting_reads_ == 0) port_.input_limit_ = kInputLimit;
  }
  Room(const Room&) = delete;
  Room& operator=(const Room&) = delete;

 private:
  BlockingPort& port_;
};

Result<Transfer> BlockingPort::wait_for_input(const Condition& enough, std::size_t room, Micros timeout) {
  if (Result<void> may = check_read(); !may) return may.error();
  if (enough()) return Transfer{};
  reopen();
  const std::uint64_t line = line_;
  const LoopWait::End end = wait_on_line(enough, room, timeout);
  if (enough()) return Transfer{};
  if (line_ != line)
    return Transfer{0, Transfer::End::closed};  // another call has seen its end, or closed it
  if (down_ && down_->error.code == Errc::damaged_tape) {
    Error error = down_->error;
    line_ended();
    return error;
  }
  if (down_ || ended_) return line_ended();
  if (!open_) return Transfer{0, Transfer::End::closed};
  if (end == LoopWait::End::timed_out) return Transfer{0, Transfer::End::timed_out};
  const std::string awaited = awaits();
  if (awaited.empty()) return line_ended();  // a tape at its end
  return make_error(Errc::io, "reading would wait for ever: " + awaited);
}

LoopWait::End BlockingPort::wait_on_line(const Condition& enough, std::size_t room, Micros timeout) {
  const std::uint64_t line = line_;
  const Condition over = [&] { return enough() || down_ || ended_ || !open_ || line_ != line; };
  const Room kept(*this, room);
  for (;;) {
    const LoopWait::End end = wait_.until_or_quiet(over, timeout);
    const bool another_may_write = writer_ != number_of_this_thread();
    if (end != LoopWait::End::stalled || !another_may_write || awaits().empty()) return end;
    wait_.until_next_call(over);
  }
}

// What the caller has to do so that anything can come.
std::string BlockingPort::awaits() {
  WaitingCalls* const calls = port_->waiting();
  return calls == nullptr ? std::string() : calls->awaits();
}

Transfer BlockingPort::line_ended() {
  if (!open_) return {0, Transfer::End::closed};
  if (always_open_) {
    ++line_;
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
  const LoopWait::Call call(wait_);
  if (input_.size() < into.size() && open_) wait_.poll();
  const Result<Transfer> waited =
      wait_for_input([&] { return !input_.empty() || into.empty(); }, into.size(), timeout_);
  if (!waited || !waited->done()) return waited;
  return take(std::min(input_.front_size(), into.size()), into);
}

Result<Transfer> BlockingPort::read_string(std::string& into) {
  const LoopWait::Call call(wait_);
  if (open_) wait_.poll();
  const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout_);
  if (!waited || !waited->done()) return waited;
  into.assign(as_text(input_.view().first(input_.front_size())));
  return take(into.size(), {reinterpret_cast<Byte*>(into.data()), into.size()});
}

Result<Transfer> BlockingPort::read_full(std::span<Byte> into) {
  const LoopWait::Call call(wait_);
  const Result<Transfer> waited =
      wait_for_input([&] { return input_.size() >= into.size(); }, into.size(), kForever);
  if (!waited || !waited->done()) return waited;
  return take(into.size(), into);
}

Result<Transfer> BlockingPort::read_until(std::span<Byte> into, Byte end) {
  const LoopWait::Call call(wait_);
  Search found(input_, end);
  const auto enough = [&] { return found() || input_.size() >= into.size(); };
  const Result<Transfer> waited = wait_for_input(enough, into.size(), timeout_);
  if (!waited || !waited->done()) return waited;
  const std::optional<std::size_t> at = found();
  return take(std::min(at ? *at + 1 : into.size(), into.size()), into);
}

Result<Transfer> BlockingPort::read_string_until(std::string& into, char end) {
  const LoopWait::Call call(wait_);
  Search found(input_, static_cast<Byte>(end));
  const auto enough = [&] { return found() || input_.size() >= kLongestLine; };
  const Result<Transfer> waited = wait_for_input(enough, kLongestLine, timeout_);
  if (!waited || !waited->done()) return waited;
  const std::optional<std::size_t> at = found();
  if (!at) return make_error(Errc::io, fmt::format("no end of line in {} bytes", kLongestLine));
  into.resize(*at + 1);
  return take(into.size(), {reinterpret_cast<Byte*>(into.data()), into.size()});
}

Result<Transfer> BlockingPort::skip(std::size_t count) {
  const LoopWait::Call call(wait_);
  const Micros timeout = timeout_;
  std::size_t skipped = 0;
  while (skipped < count) {
    const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout);
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
  const LoopWait::Call call(wait_);
  const Micros timeout = timeout_;
  std::size_t skipped = 0;
  while (times > 0) {
    const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout);
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
  const LoopWait::Call call(wait_);
  if (Result<void> may = check_read(); !may) return may.error();
  wait_.poll();
  return input_.front_size();
}

Result<Transfer> BlockingPort::bytes_available_wait() {
  const LoopWait::Call call(wait_);
  if (open_) wait_.poll();
  const Result<Transfer> waited = wait_for_input([&] { return !input_.empty(); }, 1, timeout_);
  if (!waited || !waited->done()) return waited;
  return Transfer{input_.front_size()};
}

Error BlockingPort::broken() const {
  if (!down_->error.message.empty()) return down_->error;
  // Another call may have let the port go.
  return make_error(Errc::device_lost, (port_ ? port_->name() : spec_.name()) + ": the line is down");
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
  const LoopWait::Call call(wait_);
  return write(data, timeout_);
}

Result<Transfer> BlockingPort::write(ByteView data, Micros timeout) {
  if (Result<void> may = check_write(); !may) return may.error();
  if (port_->keeps_datagrams() && data.size() > Port::kLargestDatagram) {
    return make_error(Errc::usage, fmt::format("{} bytes do not fit a datagram, which holds at most {}",
                                               data.size(), Port::kLargestDatagram));
  }
  writer_ = number_of_this_thread();
  reopen();
  const Remaining left(loop_.clock(), timeout);
  wait_.poll();
  const std::uint64_t line = line_;
  const auto over = [&] { return down_ || line_ != line; };
  std::size_t sent = 0;
  while (!over() && !data.empty()) {
    if (up_ && !port_->congested()) {
      if (sent == data.size()) break;
      const ByteView rest = data.subspan(sent);
      const ByteView piece = port_->keeps_datagrams() ? rest : rest.first(std::min(rest.size(), kWriteChunk));
      drained_ = false;
      const std::size_t taken = write_some(piece);
      sent += taken;
      if (taken == piece.size()) continue;
    }
    const auto can_go_on = [&] { return over() || (up_ && drained_ && !port_->congested()); };
    if (wait_.until(can_go_on, left()) != LoopWait::End::ready) break;
  }
  wait_.poll();  // a line that broke while it took the bytes
  written_bytes_ += sent;
  // Another call has seen the end of the line, or closed it.
  if (line_ != line && open_) return Transfer{sent, Transfer::End::closed};
  if (line_ != line && !down_ && sent == 0) return usage_error("the port is not open");
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
  const LoopWait::Call call(wait_);
  const Micros timeout = timeout_;
  std::size_t sent = 0;
  while (sent < data.size()) {
    const Result<Transfer> step = write(data.subspan(sent), timeout);
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
  const LoopWait::Call call(wait_);
  if (!open_) return usage_error("the port is not open");
  wait_.poll();
  if (!port_) return {};
  if (WaitingCalls* const calls = port_->waiting(); calls != nullptr && !calls->discard()) return {};
  input_.clear();
  consumed();
  return {};
}

Result<Transfer> BlockingPort::drain() {
  const LoopWait::Call call(wait_);
  if (!open_) return usage_error("the port is not open");
  // The kernel does not tell when its queue is empty.
  const std::uint64_t line = line_;
  const auto over = [&] { return down_ || line_ != line; };
  const auto empty = [&] { return over() || (!port_->congested() && unsent() == 0); };
  if (wait_.until_seen(empty, timeout_) != LoopWait::End::ready) return Transfer{0, Transfer::End::timed_out};
  if (!over()) return Transfer{};
  return Transfer{0, Transfer::End::closed};
}

bool BlockingPort::plays_tape() const { return spec_.get<ReplayOptions>() != nullptr; }

// The tape has the request before its result.
Result<void> BlockingPort::set_line(unsigned baud) {
  const std::optional<LineSettings> now = port_->settings();
  if (!now && !plays_tape()) return make_error(Errc::usage, port_->name() + " has no baud rate");
  const SeenSettings known = now ? SeenSettings::of(*now) : SeenSettings{};
  const SeenSettings wanted = SeenSettings{.baud = baud}.over(known);
  if (open_) port_->tell(line::Settings{wanted});
  return now ? port_->apply(wanted.over(*now)) : Result<void>();
}

Result<void> BlockingPort::set_baud(unsigned baud) {
  const LoopWait::Call call(wait_);
  if (port_ && !completing_) {
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
  const LoopWait::Call call(wait_);
  const Micros timeout = timeout_;
  const std::string waits = timeout < Micros{0}
                                ? "for ever"
                                : fmt::format("{:.6f} s", std::chrono::duration<double>(timeout).count());
  const std::string_view state = !open_ ? "not open" : up_ ? "open" : down_ ? "down" : "being opened again";
  std::string out = fmt::format("{}\nState: {}\nTimeout: {}\nPermissions: {}{}{}\n", spec_.name(), state,
                                waits, can_read() ? "read" : "", can_read() && can_write() ? ", " : "",
                                can_write() ? "write" : "");
  if (always_open_) out += "Always open\n";
  for (const auto& [option, value] : spec_.written().values) out += fmt::format("{}: {}\n", option, value);
  return out + fmt::format("Bytes read: {}, written: {}, waiting to be read: {}\n", read_bytes_,
                           written_bytes_, input_.size());
}

}  // namespace porttape
