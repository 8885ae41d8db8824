#include "libport/faults/fault_port.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

// A line that comes up again by itself is away so long at least, as after a first failure.
constexpr Nanos kShortest = std::chrono::milliseconds(100);

std::string text_of(const std::map<std::string, std::uint64_t>& sum) {
  std::string text;
  for (const auto& [kind, count] : sum) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, kind);
  return text;
}

}  // namespace

FaultPort::FaultPort(const PortContext& context, std::unique_ptr<Port> inner, FaultOptions options)
    : FilterPort(context, std::move(inner)),
      context_(context),
      options_(std::move(options)),
      plan_{.kind = LineFault::kPlan, .spec = options_.plan.text(), .seed = options_.seed},
      break_timer_(*context.loop, [this] { do_timed_breaks(); }),
      back_timer_(*context.loop, [this] { come_back(); }) {
  for (const Fault& fault : options_.plan.faults) {
    const bool breaks = fault.kind == Fault::Kind::hangup || fault.kind == Fault::Kind::replug;
    if (breaks && fault.when == Fault::When::time) timed_.push_back({&fault});
  }
}

Result<void> FaultPort::prepare() {
  inner().tell(plan_);
  if (Result<void> prepared = FilterPort::prepare(); !prepared) return prepared;
  context_.log->warn("{}: this line has faults made on purpose: {}; seed {}", name(), plan_.spec.for_line(),
                     options_.seed);
  return {};
}

// Whether the line has datagrams a tape may know only once it is read.
FaultStream& FaultPort::stream(LineDir dir) {
  std::optional<FaultStream>& of = dir == LineDir::r ? to_driver_ : to_device_;
  if (!of) of.emplace(options_.plan, options_.seed, dir, keeps_datagrams());
  return *of;
}

bool FaultPort::away() const { return now() < away_until_; }

void FaultPort::open() {
  if (!away()) return FilterPort::open();
  if (options_.waits || options_.always_open) {
    open_wanted_ = true;
    back_timer_.set(away_until_);
    return;
  }
  const double left = std::chrono::duration<double>(away_until_ - now()).count();
  listener().on_down(
      {.reason = LineDown::Reason::failed,
       .error = make_error(Errc::device_missing,
                           fmt::format("{}: unplugged by a fault, for {:.3f} s more", name(), left))});
}

void FaultPort::close() {
  ++lines_;
  up_ = open_wanted_ = false;
  FilterPort::close();
  tell_sum();
}

void FaultPort::on_up() {
  ++lines_;
  up_ = true;
  made(plan_);
  if (!zero_) {
    zero_ = now();
    do_timed_breaks();
    if (!up_) return;
  }
  FilterPort::on_up();
}

void FaultPort::incoming(ByteView arrival) {
  if (interrupted_) return;
  pass(LineDir::r, arrival, [this](ByteView data, Instant due) { deliver(data, due); });
}

void FaultPort::outgoing(ByteView data) {
  if (!up_) return send(data);  // to nobody
  pass(LineDir::w, data, [this](ByteView piece, Instant due) { send(piece, due); });
}

void FaultPort::pass(LineDir dir, ByteView data, const std::function<void(ByteView, Instant)>& on) {
  if (options_.on_passing) options_.on_passing(dir, data);
  const Instant at = now();
  const FaultStream::Outcome outcome = stream(dir).take(data, at, zero_.value_or(at));
  const unsigned line = lines_;
  for (const LineFault& fault : outcome.faults) made(fault);
  if (outcome.untouched) return on(data, {});
  for (const FaultStream::Piece& piece : outcome.pieces) {
    if (line != lines_) return;  // closed, by one who got the piece before
    on(piece.data, piece.due);
  }
  if (outcome.broken != nullptr && line == lines_) break_line(*outcome.broken);
}

void FaultPort::made(const LineFault& fault) {
  if (fault.kind != LineFault::kPlan) {
    ++sum_[fault.kind.raw()];
    if (options_.on_made) options_.on_made(fault);
    if (++told_ > kMostTold) {
      ++untold_;
      return;
    }
    inner().tell(fault);
  }
  listener().told(fault);
}

void FaultPort::tell_sum() {
  if (const std::uint64_t count = std::exchange(untold_, 0); count > 0) {
    const LineFault more{.kind = LineFault::kMore, .count = count};
    inner().tell(more);
    listener().told(more);
  }
  if (const auto sum = std::exchange(sum_, {}); !sum.empty())
    context_.log->info("{}: faults made: {}", name(), text_of(sum));
}

// Also while the line is down: a device that is away then is away for the next one who wants it.
void FaultPort::do_timed_breaks() {
  std::optional<Instant> next;
  for (TimedBreak& each : timed_) {
    if (each.over) continue;
    const Instant due = *zero_ + each.fault->at;
    if (due > now()) {
      next = next ? std::min(*next, due) : due;
      continue;
    }
    each.over = true;
    made({.kind = std::string(to_string(each.fault->kind)), .spec = to_text(*each.fault)});
    break_line(*each.fault);
  }
  if (next) break_timer_.set(*next);
}

void FaultPort::break_line(const Fault& fault) {
  const bool was_up = std::exchange(up_, false);
  const bool reopens = options_.always_open;
  const Nanos length = reopens ? std::max(fault.length, kShortest) : fault.length;
  away_until_ = std::max(away_until_, now() + length);
  const LineDown down{.reason = LineDown::Reason::lost,
                      .error = make_error(Errc::device_lost, fmt::format("{}: unplugged by the fault {}",
                                                                         name(), to_text(fault))),
                      .after_reading = true};  // the break is behind its byte, however slow the driver reads
  if (passive()) {                             // its peer may come back at once, whatever is kept open
    away_until_ = {};
    if (was_up) hang_up(false);
  } else if (reopens) {
    up_ = was_up;
    back_timer_.set(away_until_);
    if (!std::exchange(interrupted_, true)) listener().on_interrupted(down);
  } else if (was_up) {
    close();
    listener().on_down(down);
  }
}

void FaultPort::come_back() {
  if (away()) return back_timer_.set(away_until_);
  if (std::exchange(interrupted_, false)) listener().on_resumed();
  if (std::exchange(open_wanted_, false)) FilterPort::open();
}

// The loop's thread waits for nobody but these.
std::optional<Instant> FaultPort::next_due() {
  std::optional<Instant> next = FilterPort::next_due();
  for (const Timer* timer : {&break_timer_, &back_timer_}) {
    if (timer->due() && (!next || *timer->due() < *next)) next = timer->due();
  }
  return next;
}

}  // namespace porttape
