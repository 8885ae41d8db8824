#include "libport/tape/cut_tape.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/exchange_count.hpp"

namespace porttape {
namespace {

std::string cut_seconds(TapeTime time) {
  std::array<char, 40> text{};
  const long long us = to_us(time);
  std::snprintf(text.data(), text.size(), "%lld.%06lld s", us / 1'000'000, us % 1'000'000);
  return text.data();
}

bool is_end(const Record& record) {
  return record.event != nullptr && std::holds_alternative<event::End>(*record.event);
}

// Where the records of a tape are that are told it in order: before a range, in it, behind it.
class RangeWatch {
 public:
  enum class Place : std::uint8_t { before, inside, behind };

  explicit RangeWatch(CutRange range) : range_(std::move(range)) {}

  Place place_of(const Record& record) {
    return std::visit([&](const auto& range) { return look(range, record); }, range_);
  }
  // Why nothing was in it, once all is told.
  [[nodiscard]] std::string nothing_kept(TapeTime end) const {
    return std::visit([&](const auto& range) { return why(range, end); }, range_);
  }
  // A mark that ends the range was not there.
  [[nodiscard]] std::optional<std::string> open_end() const {
    const auto* marks = std::get_if<MarkRange>(&range_);
    if (marks == nullptr || !marks->last || over_) return std::nullopt;
    return no_mark(*marks->last);
  }

 private:
  static Place look(const TimeRange& range, const Record& record) {
    if (record.at < range.from) return Place::before;
    return record.at < range.to ? Place::inside : Place::behind;
  }

  Place look(const ExchangeRange& range, const Record& record) {
    if (record.kind == RecordKind::open || record.kind == RecordKind::close) exchanges_.on_open_or_close();
    if (record.kind == RecordKind::write) exchanges_.on_write();
    if (record.kind == RecordKind::read) exchanges_.on_read();
    if (exchanges_.count() < range.first) return Place::before;
    return exchanges_.count() <= range.last ? Place::inside : Place::behind;
  }

  Place look(const MarkRange& range, const Record& record) {
    if (!begun_ && !range.first) begun_ = true;
    if (over_) return Place::behind;
    const auto* mark = record.event == nullptr ? nullptr : std::get_if<event::Mark>(record.event);
    if (mark == nullptr) return begun_ ? Place::inside : Place::before;
    if (marks_.size() < kMostMarks) marks_.push_back(mark->text.raw());
    const bool ends = begun_ && range.last && mark->text.raw() == *range.last;
    if (range.first && mark->text.raw() == *range.first) begun_ = true;
    over_ = ends;
    return begun_ ? Place::inside : Place::before;
  }

  static std::string why(const TimeRange& range, TapeTime end) {
    const std::string to = range.to == TapeTime::max() ? "on" : "to " + cut_seconds(range.to);
    return "it has nothing from " + cut_seconds(range.from) + " " + to + ": it ends at " + cut_seconds(end);
  }
  [[nodiscard]] std::string why(const ExchangeRange&, TapeTime) const {
    return "it has only " + std::to_string(exchanges_.count()) +
           (exchanges_.count() == 1 ? " exchange" : " exchanges");
  }
  [[nodiscard]] std::string why(const MarkRange& range, TapeTime) const {
    return range.first ? no_mark(*range.first) : "it is empty";
  }

  [[nodiscard]] std::string no_mark(const std::string& text) const {
    const std::string after = begun_ && std::get<MarkRange>(range_).first
                                  ? " behind " + in_quotes(*std::get<MarkRange>(range_).first)
                                  : "";
    std::string message = "it has no mark " + in_quotes(text) + after;
    if (marks_.empty()) return message + "; it has no marks";
    const std::vector<std::string_view> known(marks_.begin(), marks_.end());
    if (const auto near = nearest(text, known)) return message + "; did you mean " + in_quotes(*near) + "?";
    message += "; its marks are ";
    for (std::size_t i = 0; i < std::min(marks_.size(), kMarksTold); ++i)
      message += (i == 0 ? "" : ", ") + in_quotes(marks_[i]);
    return marks_.size() > kMarksTold ? message + ", …" : message;
  }

  static constexpr std::size_t kMostMarks = 64;
  static constexpr std::size_t kMarksTold = 5;

  CutRange range_;
  ExchangeCount exchanges_;
  std::vector<std::string> marks_;  // the first ones
  bool begun_ = false;
  bool over_ = false;
};

// Goes over a tape and writes what of it is in a range.
class TapeCutter {
 public:
  TapeCutter(TapeReader& reader, std::string name, const TapePaths& to, const CutOptions& options)
      : reader_(reader), name_(std::move(name)), options_(options), watch_(options.range) {
    done_.paths = to;
  }

  Result<CutTape> run() {
    for (;;) {
      const Result<std::optional<Record>> next = reader_.next();
      if (!next) return next.error();
      if (!*next) break;
      const Record& record = **next;
      if (options_.progress) options_.progress(bytes_ += bytes_in_file(record));
      // A block in pieces is where its first one is.
      if (record.piece_offset == 0) place_ = watch_.place_of(record);
      if (place_ == RangeWatch::Place::behind) return finish_before_rest();
      if (Result<void> taken = take(record); !taken) return taken.error();
    }
    if (const auto missing = watch_.open_end(); missing && part_) return nothing(*missing);
    done_.half = reader_.half();
    const bool ends = ended_ || (!reader_.has_events() && !done_.half);
    return finish(ends && part_ ? std::optional(std::max(last_, part_->latest())) : std::nullopt);
  }

 private:
  Result<void> take(const Record& record) {
    last_ = record.at;
    ended_ = is_end(record);
    if (place_ == RangeWatch::Place::before) {
      before_.pass(record);
      return {};
    }
    if (ended_) return {};
    if (!part_) {
      if (Result<void> begun = begin(record.at); !begun) return begun;
    }
    done_.to = record.at;
    if (record.event != nullptr) ++done_.events;
    if (record.event == nullptr && record.piece_offset == 0) ++done_.blocks;
    return part_->copy(record);
  }

  Result<void> begin(TapeTime from) {
    Result<PartWriter> part = PartWriter::begin(reader_, before_,
                                                {.to = done_.paths,
                                                 .writer = options_.writer,
                                                 .by = "cut",
                                                 .name = name_,
                                                 .from = from,
                                                 .rebased = options_.rebased,
                                                 .previous = {}});
    if (!part) return part.error();
    part_.emplace(std::move(*part));
    done_.from = from;
    return {};
  }

  // Only the tape's end tells whether the part is what was recorded. Where damage keeps that from being read,
  // the part has none.
  Result<CutTape> finish_before_rest() {
    if (!part_) return finish(std::nullopt);
    for (;;) {
      const Result<std::optional<Record>> next = reader_.next();
      if (!next && (next.error().code != Errc::damaged_tape || reader_.came_to_end())) return next.error();
      if (!next) done_.damage_behind = next.error();
      if (!next || !*next) break;
      if (options_.progress) options_.progress(bytes_ += bytes_in_file(**next));
    }
    done_.half = reader_.half();
    const bool whole = !done_.damage_behind && !done_.half;
    return finish(whole ? std::optional(part_->latest()) : std::nullopt);
  }

  [[nodiscard]] Error nothing(const std::string& why) const {
    return make_error(Errc::usage, "nothing is cut out of " + in_quotes(name_) + ": " + why);
  }

  // The tape's own end is kept, and that it has none.
  Result<CutTape> finish(std::optional<TapeTime> end) {
    if (!part_) return nothing(watch_.nothing_kept(last_));
    Result<TapePaths> paths = part_->finish(end);
    if (!paths) return paths.error();
    done_.paths = *paths;
    return done_;
  }

  TapeReader& reader_;
  std::string name_;
  const CutOptions& options_;
  RangeWatch watch_;
  RangeWatch::Place place_ = RangeWatch::Place::before;
  LineState before_;
  std::optional<PartWriter> part_;
  CutTape done_;
  TapeTime last_{};
  bool ended_ = false;
  std::uint64_t bytes_ = 0;
};

}  // namespace

Result<CutTape> cut_tape(const TapePaths& from, const TapePaths& to, const CutOptions& options) {
  Result<TapeReader> reader = TapeReader::open(from);
  if (!reader) return reader.error();
  return TapeCutter(*reader, from.file_name(), to, options).run();
}

}  // namespace porttape
