#include "libport/tape/tape_summary.hpp"

#include <algorithm>
#include <utility>

#include "libport/tape/block_file.hpp"
#include "libport/tape/end_check.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/exchange_count.hpp"
#include "libport/tape/merge_order.hpp"
#include "libport/tape/quantiles.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMaxKinds = 64;
constexpr std::size_t kMaxGaps = 64;
constexpr std::size_t kMaxFaults = 64;
constexpr std::size_t kMaxSessions = 1000;
constexpr std::size_t kMaxMarks = 64;
constexpr std::size_t kMaxSettings = 64;
constexpr std::size_t kMaxSignals = 64;
// Of empty blocks at time 0; a page of zeros has more. No peer sends so many empty datagrams in the first
// microsecond, and a disk that kept a file's length and lost its bytes has nothing else.
constexpr std::size_t kMaxEmptyAtZero = 4096 / kMaxHeaderSize;

// Counts exchanges and measures answers, told the blocks in order.
class ExchangeMeter {
 public:
  void on_write(TapeTime at) {
    exchanges_.on_write();
    asked_ = at;
  }
  void on_read(TapeTime at) {
    if (exchanges_.on_read()) latency_.add((at - asked_).count());
  }
  void on_open_or_close() { exchanges_.on_open_or_close(); }

  void report(TapeSummary& summary) const {
    summary.exchanges = exchanges_.count();
    summary.answered = latency_.count();
    if (latency_.count() == 0) return;
    summary.latency = LatencySummary{latency_.min(), latency_.at(0.5), latency_.at(0.99), latency_.max()};
  }

 private:
  ExchangeCount exchanges_;
  TapeTime asked_{};
  Quantiles latency_;
};

// Tells the tape's sessions apart, by its opens and closes and the bytes before them.
class SessionMeter {
 public:
  struct Passed {  // bytes
    std::uint64_t read = 0;
    std::uint64_t write = 0;
  };

  void on_open(TapeTime at, const Passed& before) {
    end(at, before);
    open_.emplace();
    open_->opened = at;
    opened_at_ = at;
    before_ = before;
    ++count_;
  }
  void on_close(TapeTime at, const Passed& before) {
    if (open_) open_->closed = at;
    end(at, before);
  }
  // What is left open ends with the tape; one without opens is one session.
  void report(TapeTime last, const Passed& all, TapeSummary& summary) {
    if (count_ == 0 && all.read + all.write > 0) {
      open_ = SessionSummary{};
      count_ = 1;
    }
    end(last, all);
    summary.session_count = count_;
    summary.sessions = std::move(sessions_);
  }

 private:
  void end(TapeTime at, const Passed& passed) {
    if (!open_) return;
    open_->duration = std::max(at - opened_at_, Micros{});
    open_->read_bytes = passed.read - before_.read;
    open_->write_bytes = passed.write - before_.write;
    if (sessions_.size() < kMaxSessions) sessions_.push_back(*open_);
    open_.reset();
  }

  std::optional<SessionSummary> open_;
  TapeTime opened_at_{};
  Passed before_;
  std::uint64_t count_ = 0;
  std::vector<SessionSummary> sessions_;
};

// One r or w file with its next block in view.
class BlockStream {
 public:
  BlockStream(std::unique_ptr<ByteSource> source, Layout layout, bool with_digest, FileSummary& summary)
      : summary_(summary), payload_(with_digest) {
    summary_.xxh3 = payload_.totals().xxh3;
    summary_.xxh3_all = payload_.totals().xxh3_all;
    if (!source) return;
    summary_.exists = true;
    summary_.path = source->name();
    const auto size = source->size();
    summary_.file_bytes = size ? *size : 0;
    file_.emplace(std::move(source), layout, BlockFile::Blocks::in_pieces);
    advance();
  }

  // When the block in view is.
  [[nodiscard]] TapeTime at() const { return has_block_ ? file_->piece().at : kNoMore; }
  [[nodiscard]] bool failed() const { return summary_.damage.has_value(); }
  // Payload before the block in view.
  [[nodiscard]] std::uint64_t bytes_before() const {
    return payload_.bytes() - (has_block_ ? file_->piece().data.size() : 0);
  }

  // Counts the block in view and goes on to the next one.
  void advance() {
    for (;;) {
      const BlockFile::Step step = file_->next();
      if (step != BlockFile::Step::piece) [[unlikely]]
        return stop(step);
      const BlockPiece& piece = file_->piece();
      if (piece.piece_offset == 0) payload_.begin_block(piece.at, piece.block_length);
      payload_.add(piece.data);
      if (piece.piece_offset > 0) continue;
      largest_ = std::max(largest_, piece.block_length);
      if (!summary_.first) summary_.first = piece.at;
      last_ = piece.at;
      has_block_ = true;
      if (piece.block_length == 0 && piece.at == TapeTime{} && ++empty_at_zero_ > kMaxEmptyAtZero)
          [[unlikely]]
        return stop_in_zeros();
      return;
    }
  }

 private:
  void stop_in_zeros() {
    stop(BlockFile::Step::end);
    summary_.damage =
        make_error(Errc::damaged_tape, summary_.path +
                                           ": begins with zeros, as where a disk has lost what was written: "
                                           "they read as empty blocks at time 0");
  }

  void stop(BlockFile::Step step) {
    has_block_ = false;
    const PayloadTotals totals = payload_.totals();
    summary_.blocks = totals.blocks;
    summary_.bytes = totals.bytes;
    summary_.xxh3 = totals.xxh3;
    summary_.xxh3_all = totals.xxh3_all;
    summary_.largest_block = largest_;
    if (totals.blocks > 0) summary_.last = last_;
    if (step == BlockFile::Step::failed) summary_.damage = file_->error();
    summary_.torn_bytes = file_->torn_bytes();
    summary_.torn_tail = file_->torn_tail();
  }

  FileSummary& summary_;
  std::optional<BlockFile> file_;
  bool has_block_ = false;
  PayloadCounter payload_;
  std::uint32_t largest_ = 0;
  TapeTime last_{};
  std::size_t empty_at_zero_ = 0;
};

// The events file with its next event in view.
class EventStream {
 public:
  explicit EventStream(EventsSummary& summary) : summary_(summary) {}

  Result<void> open(std::unique_ptr<ByteSource> source) {
    if (!source) return {};
    summary_.exists = true;
    summary_.path = source->name();
    auto file = EventFile::create(std::move(source));
    if (!file && file.error().code == Errc::damaged_tape) summary_.damage = file.error();
    if (!file) return summary_.damage ? Result<void>() : Result<void>(file.error());
    file_.emplace(std::move(*file));
    summary_.header = file_->header();
    advance();
    return {};
  }

  // When the event in view is.
  [[nodiscard]] TapeTime at() const { return has_event_ ? file_->event().at : kNoMore; }
  [[nodiscard]] bool failed() const { return summary_.damage.has_value(); }
  [[nodiscard]] const Event& event() const { return file_->event().what; }

  void advance() {
    const EventFile::Step step = file_->next();
    has_event_ = step == EventFile::Step::event;
    if (!has_event_) {
      if (step == EventFile::Step::failed) summary_.damage = file_->error();
      summary_.torn_tail = file_->torn_tail();
      summary_.header = file_->header();  // with the zero that an event has told
      return;
    }
    const auto& [at, event] = file_->event();
    const StrangerText kind(name_of(event));
    if (summary_.kinds.size() < kMaxKinds || summary_.kinds.contains(kind)) ++summary_.kinds[kind];
    if (const auto* gap = std::get_if<event::Gap>(&event)) note_gap(at, *gap);
    const auto* mark = std::get_if<event::Mark>(&event);
    if (mark != nullptr && summary_.marks.size() < kMaxMarks) summary_.marks.push_back({at, mark->text});
    const auto* settings = std::get_if<event::Settings>(&event);
    if (settings != nullptr && summary_.settings.size() < kMaxSettings)
      summary_.settings.push_back({at, *settings});
    if (const auto signal = signal_of(event); signal && summary_.signals.size() < kMaxSignals)
      summary_.signals.push_back({at, *signal});
    if (const auto* fault = std::get_if<event::Fault>(&event)) note_fault(at, *fault);
    const auto* end = std::get_if<event::End>(&event);
    summary_.ended = end != nullptr;
    const bool tells = end != nullptr && end->read && end->write;
    summary_.end_read = tells ? end->read : std::nullopt;
    summary_.end_write = tells ? end->write : std::nullopt;
    summary_.covers_lines = end != nullptr && end->events;
    summary_.last = at;
  }

 private:
  void note_fault(TapeTime at, const event::Fault& event) {
    const LineFault& fault = event.fault;
    if (summary_.faults.size() < kMaxFaults) summary_.faults.push_back({at, event});
    const bool known = summary_.fault_kinds.size() < kMaxKinds || summary_.fault_kinds.contains(fault.kind);
    if (fault.kind != LineFault::kPlan && known)
      summary_.fault_kinds[fault.kind] += fault.kind == LineFault::kMore ? fault.count : 1;
  }

  void note_gap(TapeTime at, const event::Gap& gap) {
    summary_.gap_bytes += gap.bytes;
    if (summary_.gaps.size() < kMaxGaps)
      summary_.gaps.push_back({gap.from.value_or(TapeTime{}), at, gap.bytes, gap.why});
  }

  EventsSummary& summary_;
  std::optional<EventFile> file_;
  bool has_event_ = false;
};

struct Meters {
  ExchangeMeter exchanges;
  SessionMeter sessions;
};

void meet(const Event& event, TapeTime at, const SessionMeter::Passed& before, Meters& meters) {
  const bool opens = std::holds_alternative<event::Open>(event);
  if (!opens && !std::holds_alternative<event::Close>(event)) return;
  meters.exchanges.on_open_or_close();
  opens ? meters.sessions.on_open(at, before) : meters.sessions.on_close(at, before);
}

// Goes through the three in the tape's order. Behind damage the order is unknown, so exchanges and sessions
// are counted no further.
void merge(BlockStream& read, BlockStream& write, EventStream& events, Meters& meters) {
  ExchangeMeter& meter = meters.exchanges;
  for (;;) {
    const bool ordered = !read.failed() && !write.failed() && !events.failed();
    switch (next_in_order(events.at(), write.at(), read.at())) {
      case TapeFile::none:
        return;
      case TapeFile::events:
        if (ordered) meet(events.event(), events.at(), {read.bytes_before(), write.bytes_before()}, meters);
        events.advance();
        break;
      case TapeFile::write:
        if (ordered) meter.on_write(write.at());
        write.advance();
        break;
      case TapeFile::read:
        if (ordered) meter.on_read(read.at());
        read.advance();
        break;
    }
  }
}

}  // namespace

std::uint64_t EventsSummary::count(std::string_view kind) const {
  const auto found = kinds.find(kind);
  return found == kinds.end() ? 0 : found->second;
}

Micros TapeSummary::duration() const {
  const TapeTime zero{};
  return std::max({read.last.value_or(zero), write.last.value_or(zero), events.last.value_or(zero)}) - zero;
}

std::vector<Error> TapeSummary::damages() const {
  std::vector<Error> all;
  for (const auto* damage : {&read.damage, &write.damage, &events.damage}) {
    if (*damage) all.push_back(**damage);
  }
  return all;
}

std::vector<std::string> TapeSummary::torn_tails() const {
  std::vector<std::string> all;
  for (const auto* note : {&read.torn_tail, &write.torn_tail, &events.torn_tail}) {
    if (*note) all.push_back(**note);
  }
  return all;
}

Result<TapeSummary> summarize(const TapePaths& paths) {
  auto sources = TapeSources::open(paths);
  if (!sources) return sources.error();
  // Looked at first: a tape that ends meanwhile may have been read before its end.
  const bool being_written = is_being_written(paths);
  auto summary = summarize(paths.name(), std::move(*sources));
  if (summary) summary->being_written = being_written;
  return summary;
}

Result<TapeSummary> summarize(std::string name, TapeSources sources) {
  const auto layout = sources.layout();
  if (!layout) return layout.error();
  TapeSummary summary;
  summary.name = std::move(name);
  summary.layout = *layout;
  summary.read.path = summary.name + "r";
  summary.write.path = summary.name + "w";
  summary.events.path = summary.name + "e";
  EventStream events(summary.events);
  if (const auto opened = events.open(std::move(sources.events)); !opened) return opened.error();
  const bool with_digest = has_digests(summary.events.header);
  BlockStream read(std::move(sources.read), *layout, with_digest, summary.read);
  BlockStream write(std::move(sources.write), *layout, with_digest, summary.write);
  Meters meters;
  merge(read, write, events, meters);
  meters.exchanges.report(summary);
  const TapeTime last = TapeTime{} + summary.duration();
  meters.sessions.report(last, {summary.read.bytes, summary.write.bytes}, summary);
  return summary;
}

}  // namespace porttape
