#include "libport/taped/tape_stats.hpp"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "libport/rules/frame_command.hpp"
#include "libport/rules/frame_stream.hpp"
#include "libport/tape/exchange_count.hpp"
#include "libport/tape/quantiles.hpp"

namespace porttape {
namespace {

constexpr std::size_t kHead = 64;  // bytes of a run of writes that tell what it is about

SpanStats stats_of(const Quantiles& spans) {
  return {spans.count(), spans.min(), spans.at(0.5), spans.at(0.9), spans.at(0.99), spans.max()};
}

// Counts by command.
class CommandTable {
 public:
  struct Row {
    std::uint64_t count = 0;
    std::uint64_t bytes = 0;
    std::uint64_t unanswered = 0;
    Quantiles spans;
    std::optional<TapeTime> longest;
    std::optional<TapeTime> last;

    void add_span(TapeTime from, Micros span) {
      if (!longest || span.count() > spans.max()) longest = from;
      spans.add(span.count());
    }
  };

  Row& row(const std::string& command) {
    if (rows_.size() >= kMaxCommands && rows_.find(command) == rows_.end())
      return rows_[std::string(kOtherCommands)];
    return rows_[command];
  }

  [[nodiscard]] std::vector<CommandStats> result() const {
    std::vector<CommandStats> all;
    for (const auto& [command, row] : rows_)
      all.push_back({command, row.count, row.bytes, row.unanswered, stats_of(row.spans), row.longest});
    std::ranges::sort(all, {}, &CommandStats::command);
    std::ranges::stable_sort(all, std::ranges::greater{}, &CommandStats::count);
    return all;
  }

 private:
  std::unordered_map<std::string, Row> rows_;
};

// Keeps the greatest few.
template <class Value, class Greater>
void keep_greatest(std::vector<Value>& kept, std::size_t most, const Value& value, const Greater& greater) {
  kept.insert(std::upper_bound(kept.begin(), kept.end(), value, greater), value);
  if (kept.size() > most) kept.pop_back();
}

// One direction: its rate and its frames.
class DirectionMeter {
 public:
  explicit DirectionMeter(const std::vector<FrameFormat>& formats)
      : frames_(formats), pause_(frames_.pause()) {}

  void add(const Record& record, const FrameStream::Visit& visit) {
    if (pause_ && record.at - last_ >= *pause_) frames_.end(visit);
    last_ = record.at;
    if (record.piece_offset == 0) ++stats_.blocks;
    stats_.bytes += record.data.size();
    const auto second = std::chrono::floor<std::chrono::seconds>(record.at);
    if (second != second_) in_second_ = 0;
    second_ = second;
    in_second_ += record.data.size();
    if (in_second_ > stats_.busiest_bytes) {
      stats_.busiest_bytes = in_second_;
      stats_.busiest = second;
    }
    if (!frames_.formats().empty()) frames_.add(record.data, visit);
  }
  void end(const FrameStream::Visit& visit) { frames_.end(visit); }
  // The other side speaks, or nobody listens.
  void turn(const FrameStream::Visit& visit) {
    if (pause_) frames_.end(visit);
  }
  void add_stray(std::size_t bytes) { stats_.stray += bytes; }
  [[nodiscard]] const FrameFormat* format(int number) const {
    return number < 0 ? nullptr : &frames_.formats()[static_cast<std::size_t>(number)];
  }

  CommandTable& commands() { return commands_; }
  [[nodiscard]] DirectionStats result() const {
    DirectionStats stats = stats_;
    stats.commands = commands_.result();
    return stats;
  }

 private:
  FrameStream frames_;
  std::optional<Micros> pause_;
  TapeTime last_{};
  std::chrono::time_point<TapeTime::clock, std::chrono::seconds> second_{};
  std::uint64_t in_second_ = 0;
  DirectionStats stats_;
  CommandTable commands_;
};

class StatsCount {
 public:
  explicit StatsCount(const TapeStatsOptions& options)
      : options_(options),
        framed_(!options.formats.empty()),
        read_(options.formats),
        write_(options.formats) {}

  void add(const Record& record) {
    switch (record.kind) {
      case RecordKind::read:
      case RecordKind::write:
        return on_block(record);
      case RecordKind::open:
      case RecordKind::close:
      case RecordKind::hang_up:
        return on_border(record);
      case RecordKind::half_close:
      case RecordKind::gap:
      case RecordKind::event:
        return;
    }
  }

  TapeStats finish() {
    end_exchange();
    write_.end(written());
    count_unanswered();
    read_.end(received(last_.value_or(TapeTime{})));
    stats_.exchanges = exchanges_.count();
    stats_.answered = answers_.count();
    stats_.answers = stats_of(answers_);
    stats_.read = read_.result();
    stats_.write = write_.result();
    return std::move(stats_);
  }

 private:
  void on_block(const Record& record) {
    stats_.duration = record.at - TapeTime{};
    if (last_ && record.at - *last_ >= options_.silence) add_silence({*last_, record.at - *last_});
    last_ = record.at;
    record.kind == RecordKind::write ? on_write(record) : on_read(record);
  }

  void on_border(const Record& record) {
    stats_.duration = record.at - TapeTime{};
    end_exchange();
    count_unanswered();
    exchanges_.on_open_or_close();
    if (record.kind == RecordKind::open) {
      last_ = record.at;
    } else {
      last_.reset();
    }
  }

  void on_write(const Record& record) {
    read_.turn(received(record.at));
    if (record.piece_offset == 0 && exchanges_.on_write()) {
      end_exchange();
      exchange_.emplace();
      exchange_->number = exchanges_.count();
      exchange_->at = record.at;
    }
    write_.add(record, written());
    if (!exchange_) return;
    exchange_->until = asked_ = record.at;
    exchange_->written += record.data.size();
    const std::size_t room = kHead - std::min(kHead, head_.size());
    const ByteView head = record.data.first(std::min(room, record.data.size()));
    head_.insert(head_.end(), head.begin(), head.end());
  }

  void on_read(const Record& record) {
    write_.turn(written());
    waiting_.reset();
    if (exchanges_.on_read() && exchange_) {
      exchange_->answer = record.at - asked_;
      answers_.add(exchange_->answer->count());
    }
    if (exchange_) {
      exchange_->until = record.at;
      exchange_->read += record.data.size();
    }
    read_.add(record, received(record.at));
  }

  FrameStream::Visit written() {
    return [this](int format, ByteView bytes) {
      if (format < 0) return write_.add_stray(bytes.size());
      count_unanswered();
      command_ = frame_command(write_.format(format), bytes);
      waiting_ = command_;
      CommandTable::Row& row = write_.commands().row(command_);
      ++row.count;
      row.bytes += bytes.size();
    };
  }

  FrameStream::Visit received(TapeTime at) {
    return [this, at](int format, ByteView bytes) {
      if (format < 0) return read_.add_stray(bytes.size());
      CommandTable::Row& row = read_.commands().row(frame_command(read_.format(format), bytes));
      ++row.count;
      row.bytes += bytes.size();
      if (row.last) row.add_span(*row.last, at - *row.last);
      row.last = at;
    };
  }

  // The last frame written, which nothing was read behind.
  void count_unanswered() {
    if (waiting_) ++write_.commands().row(*waiting_).unanswered;
    waiting_.reset();
  }

  void end_exchange() {
    if (!exchange_) return;
    write_.turn(written());
    if (!framed_) command_ = frame_command(nullptr, head_);
    exchange_->command = command_.empty() ? frame_command(nullptr, head_) : command_;
    if (!command_.empty()) {
      CommandTable::Row& row = write_.commands().row(command_);
      if (!framed_) {
        ++row.count;
        row.bytes += exchange_->written;
      }
      if (exchange_->answer) row.add_span(exchange_->at, *exchange_->answer);
      if (!exchange_->answer && !framed_) ++row.unanswered;
    }
    if (exchange_->answer) {
      keep_greatest(stats_.slowest, options_.most, *exchange_,
                    [](const TapeExchange& a, const TapeExchange& b) { return a.answer > b.answer; });
    }
    if (options_.on_exchange) options_.on_exchange(*exchange_);
    exchange_.reset();
    head_.clear();
    command_.clear();
  }

  void add_silence(const Silence& silence) {
    ++stats_.silences;
    stats_.silent += silence.length;
    keep_greatest(stats_.longest_silences, options_.most, silence,
                  [](const Silence& a, const Silence& b) { return a.length > b.length; });
  }

  const TapeStatsOptions& options_;
  bool framed_;
  TapeStats stats_;
  ExchangeCount exchanges_;
  Quantiles answers_;
  DirectionMeter read_;
  DirectionMeter write_;
  std::optional<TapeTime> last_ = TapeTime{};  // the last block or open; none while the line is closed
  std::optional<TapeExchange> exchange_;       // that goes on
  TapeTime asked_{};
  Bytes head_;
  std::string command_;                 // of the last frame written
  std::optional<std::string> waiting_;  // that, until something is read
};

}  // namespace

Result<TapeStats> count_stats(RecordSource& tape, const TapeStatsOptions& options) {
  StatsCount count(options);
  std::uint64_t bytes = 0;
  for (;;) {
    const auto record = tape.next();
    if (!record) return record.error();
    if (!*record) break;
    count.add(**record);
    bytes += (**record).data.size();
    if (options.progress) options.progress(bytes);
  }
  return count.finish();
}

}  // namespace porttape
