#include "libport/taped/tape_keeper.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

using Phase = LiveTape::Status::Phase;
using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr Nanos kLongestRetry = seconds(30);
// How often a disk that does not answer is looked at.
constexpr Nanos kWatchEvery = milliseconds(250);

}  // namespace

TapeKeeper::TapeKeeper(const PortContext& context, Options options, std::function<void()> on_must_end)
    : context_(context),
      options_(std::move(options)),
      on_must_end_(std::move(on_must_end)),
      ending_(
          context, [this] { on_news(); }, [this] { must_end(); }, options_.on_ended),
      news_(context, options_.tape.name(), options_.fail_closed),
      retry_(options_.retry),
      retry_timer_(*context.loop, [this] { start(); }),
      watch_timer_(
          *context.loop, [this] { watch_disk(); }, Timer::By::machine) {}

TapeKeeper::~TapeKeeper() = default;

Result<void> TapeKeeper::check() const {
  if (options_.group) return {};  // was checked as a whole
  return TapeWriter::check(options_.tape, {.on_existing = options_.on_existing});
}

TapeTime TapeKeeper::tape_time(Instant at) const { return TapeTime{duration_cast<Micros>(at - zero_)}; }

void TapeKeeper::begin() {
  begun_ = true;
  open_since_ = *first_open_;
  zero_ = *first_open_;
  if (options_.group) take_part(options_.group->begin(*first_open_));
  start();
}

void TapeKeeper::take_part(const TapeGroup::Part& part) {
  part_ = part.number;
  zero_ = part.zero;
  options_.header.zero = part.header_zero;
  options_.make = [group = options_.group, part = part_, connection = options_.connection](
                      const LiveTape::Options& live) { return group->make(part, connection, live.header); };
}

void TapeKeeper::start() {
  TapeHeader header = options_.header;
  if (!options_.group) header.zero = tape_zero(zero_, context_.loop->clock());
  if (options_.describe) options_.describe(header);
  header = completed(std::move(header));
  id_ = header.id.raw();
  LiveTape::Options live{.paths = options_.tape,
                         .header = std::move(header),
                         .writer = {.on_existing = options_.on_existing, .first_number = first_number_},
                         .queue_bytes = options_.queue_bytes,
                         .on_news = ending_.news(),
                         .make = options_.make,
                         .disk_clock = options_.disk_clock};
  news_.begin();
  tape_ = std::make_unique<LiveTape>(context_.loop->workers(), context_.disks, std::move(live));
  watch_timer_.set_after(kWatchEvery);
  if (open_since_) {
    tape_->note([at = tape_time(*open_since_)](TapeWriter& writer) { writer.event(at, event::Open{}); });
  }
  note_held_settings();
  if (missed_bytes_ > 0) {
    tape_->lose(tape_time(*missed_since_), std::exchange(missed_bytes_, 0), missed_why_);
  }
}

void TapeKeeper::block(Direction direction, Instant at, ByteView data) {
  if (!tape_) {
    if (!begun_) return;  // no driver has come yet
    missed_bytes_ += data.size();
    if (!missed_since_) missed_since_ = at;
    return;
  }
  tape_->block(direction, tape_time(at), data);
  if (tape_->failing() != news_.failing() && news_.failure(tape_->status())) must_end();
  if (tape_->queued() && !watch_timer_.due()) watch_timer_.set_after(kWatchEvery);
}

// In the order in which they came.
void TapeKeeper::note_held_settings() {
  std::array held = {device_settings_, driver_settings_};
  if (held[0] && held[1] && held[1]->since < held[0]->since) std::swap(held[0], held[1]);
  for (const auto& settings : held) {
    if (!settings) continue;
    tape_->note([at = tape_time(settings->since), what = settings->what](TapeWriter& writer) {
      writer.event(at, what);
    });
  }
}

void TapeKeeper::note(Instant at, const Event& event) {
  if (const auto* settings = std::get_if<event::Settings>(&event)) {
    (settings->by == Side::driver ? driver_settings_ : device_settings_) = HeldSettings{at, *settings};
  }
  if (!tape_) return;
  tape_->note([event, time = tape_time(at)](TapeWriter& writer) { writer.event(time, event); });
}

void TapeKeeper::opened(Instant at) {
  open_ = true;
  if (!first_open_) {
    first_open_ = at;
    if (options_.group) (void)options_.group->begin(at);
  }
  if (begun_) {
    open_since_ = at;
    note(at, event::Open{});
  } else if (options_.on_existing != OnExisting::overwrite) {
    begin();
  }
}

void TapeKeeper::came_up(Instant) {
  if (open_ && !begun_) begin();
}

void TapeKeeper::closed(Instant at) {
  open_ = false;
  driver_settings_.reset();
  if (!std::exchange(open_since_, std::nullopt)) return;
  note(at, event::Close{});
}

void TapeKeeper::on_news() {
  if (!tape_) return;
  const LiveTape::Status status = tape_->status();
  if (status.phase == Phase::not_made) return not_made(status);
  const TapeNews::Found found = news_.look(status);
  if (found.made) {
    retry_ = options_.retry;
    missed_since_.reset();
    missed_why_.clear();
  }
  incomplete_ = incomplete_ || found.sync_failed;
  if (found.fails) must_end();
}

void TapeKeeper::not_made(const LiveTape::Status& status) {
  tape_.reset();
  watch_timer_.cancel();
  incomplete_ = true;
  missed_bytes_ += status.bytes_lost;
  if (!missed_since_) missed_since_ = zero_;
  if (std::exchange(missed_why_, status.error->message) != missed_why_) {
    context_.log->error("{}; nothing is recorded until that is mended, the line stays up", missed_why_);
  }
  retry_timer_.set_after(retry_);
  retry_ = std::min(retry_ * 2, kLongestRetry);
  must_end();
}

void TapeKeeper::must_end() {
  if (options_.fail_closed) on_must_end_();
}

// Runs only while blocks come.
void TapeKeeper::watch_disk() {
  if (!tape_) return;
  const LiveTape::Status status = tape_->status();
  if (!status.silence) return;
  watch_timer_.set_after(kWatchEvery);
  if (news_.silence(status)) must_end();
}

Result<bool> TapeKeeper::request(Instant at, const RecorderRequest& what) {
  if (!what.note) {
    rotate(at);
    return true;
  }
  const std::optional<Event> taped = event_of({Side::device, *what.note});
  if (!taped) return false;
  if (Result<void> noted = note_asked(at, *taped); !noted) return noted.error();
  return true;
}

Result<void> TapeKeeper::note_asked(Instant at, const Event& event) {
  if (!begun_) {
    return make_error(Errc::usage,
                      "tape " + options_.tape.name() +
                          " has not begun: no driver has opened the port yet; mark it once one has");
  }
  if (!tape_) {
    return make_error(Errc::usage,
                      "nothing is recorded now" + (missed_why_.empty() ? "" : ": " + missed_why_));
  }
  // Where the queue has it, it can only be seen how the last thing went.
  const bool queued = tape_->queued();
  if (queued) {
    if (Result<void> can = can_write(); !can) return can;
  }
  note(at, event);
  return queued ? Result<void>() : can_write();
}

// Whether the last thing could be written on the tape.
Result<void> TapeKeeper::can_write() const {
  const std::string failure = tape_->status().failure;
  if (failure.empty()) return {};
  return make_error(Errc::io,
                    "tape " + options_.tape.name() + ": nothing can be written on it now: " + failure);
}

std::optional<RecordingStatus> TapeKeeper::recording() const {
  using State = RecordingStatus::State;
  if (finished_) return std::nullopt;
  RecordingStatus recording{.state = State::waiting, .tape = options_.tape.name()};
  recording.lost_bytes = missed_bytes_;
  if (tape_) {
    const LiveTape::Status status = tape_->status();
    recording.state = status.failure.empty() ? State::recording : State::failing;
    recording.tape = status.paths.name();
    recording.bytes = status.bytes_written;
    recording.lost_bytes += status.bytes_lost;
    recording.queued_bytes = status.bytes_waiting;
    recording.why = status.failure;
  } else if (begun_) {
    recording.state = State::not_made;
    recording.why = missed_why_;
  }
  return recording;
}

// The next tape's zero is `now`. Nothing to do before the first open.
void TapeKeeper::rotate(Instant now) {
  if (!begun_) return;
  if (tape_) {
    options_.header.previous = PreviousTape{id_, tape_->status().paths.file_name()};
  }
  end_current(now);
  options_.on_existing = OnExisting::next;
  ++first_number_;
  zero_ = now;
  if (options_.group) take_part(options_.group->next(part_, now));
  if (open_since_) open_since_ = now;
  start();
}

void TapeKeeper::end_current(Instant now) {
  retry_timer_.cancel();
  watch_timer_.cancel();
  if (tape_) {
    ending_.finish(std::move(tape_), tape_time(now), {news_.sync_failed(), std::exchange(missed_bytes_, 0)});
  } else {
    tell_missed();
  }
  missed_since_.reset();
}

// Where no tape was there to tell it.
void TapeKeeper::tell_missed() {
  if (const std::uint64_t bytes = std::exchange(missed_bytes_, 0); bytes > 0)
    context_.log->error("{}", missed_text(bytes, missed_why_));
}

void TapeKeeper::finish(Instant now, std::function<void(bool)> done) {
  closed(now);
  end_current(now);
  finished_ = true;
  ending_.when_over([this, done = std::move(done)](bool complete) { done(complete && !incomplete_); });
}

void TapeKeeper::give_up() {
  if (!tape_) {
    tell_missed();
  } else if (tape_->status().bytes_waiting > 0) {  // finish() was not called
    end_current(context_.loop->now());
  }
  tape_.reset();
  ending_.give_up();
}

}  // namespace porttape
