#include "libport/tape/merge_tapes.hpp"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"
#include "libport/tape/event_file.hpp"

namespace porttape {
namespace {

// A tape that is to be merged, and what its header says once all of it is read.
struct MergeSource {
  TapePaths paths;
  std::optional<TapeHeader> header;
  Micros at{};  // its begin on the merged tape
};

// A zero that comes as an event replaces the header's.
Result<std::optional<TapeHeader>> whole_header(const TapePaths& tape) {
  Result<TapeReader> reader = TapeReader::open(tape, TapeReader::Select::merged);
  if (!reader) return reader.error();
  std::optional<TapeHeader> header = reader->header();
  if (!header || header->zero) return header;
  reader = TapeReader::open(tape, TapeReader::Select::events_only);
  if (!reader) return reader.error();
  for (;;) {
    const auto next = reader->next();
    if (!next) return next.error();
    if (!*next) return reader->header();
  }
}

// How much later than the first of them each began; nothing where they have no common clock.
std::optional<std::vector<Micros>> by_clock(const std::vector<MergeSource>& sources) {
  std::vector<Micros> offsets;
  for (const MergeSource& source : sources) {
    const auto& first = sources.front().header;
    const bool clocks = first && first->zero && source.header && source.header->zero;
    if (!clocks || first->zero->boot.empty() || first->zero->boot != source.header->zero->boot)
      return std::nullopt;
    const auto later = since(*first->zero, *source.header->zero);
    if (!later) return std::nullopt;
    offsets.push_back(*later);
  }
  return offsets;
}

// The same, of parts of one tape.
std::optional<std::vector<Micros>> by_parts(const std::vector<MergeSource>& sources) {
  std::vector<Micros> offsets;
  for (const MergeSource& source : sources) {
    const auto& first = sources.front().header;
    const auto& origin = source.header ? source.header->origin : std::nullopt;
    if (!origin || origin->by != "split" || !origin->from || !first->origin ||
        origin->tapes != first->origin->tapes)
      return std::nullopt;
    offsets.push_back(*origin->from - first->origin->from.value_or(Micros{}));
  }
  return offsets;
}

Result<void> check_sources(const std::vector<MergeSource>& sources) {
  for (auto one = sources.begin(); one != sources.end(); ++one) {
    const bool again = std::any_of(sources.begin(), one, [&](const MergeSource& other) {
      const bool same_id =
          one->header && other.header && !one->header->id.empty() && one->header->id == other.header->id;
      return same_id || one->paths == other.paths;
    });
    if (again) return make_error(Errc::usage, in_quotes(one->paths.name()) + " is given twice");
  }
  return {};
}

// A tape with its next record in view.
class MergeInput {
 public:
  MergeInput(TapeReader reader, Micros at) : reader_(std::move(reader)), at_(at) {}

  // To the first or the next record.
  Result<void> advance() {
    Result<std::optional<Record>> next = reader_.next();
    if (!next) return next.error();
    record_ = *next;
    if (record_ && record_->event != nullptr)
      ended_ = std::holds_alternative<event::End>(*record_->event);
    else if (record_)
      ended_ = false;
    if (record_) last_ = record_->at + at_;
    return {};
  }

  [[nodiscard]] bool over() const { return !record_; }
  [[nodiscard]] const Record& record() const { return *record_; }
  [[nodiscard]] TapeTime at() const { return record_->at + at_; }
  [[nodiscard]] Micros later() const { return at_; }
  [[nodiscard]] TapeTime last() const { return last_; }
  [[nodiscard]] bool lacks_end() const { return reader_.has_events() && !ended_; }
  [[nodiscard]] const TapeReader& reader() const { return reader_; }

  // Whether its record comes before the other one's.
  [[nodiscard]] bool before(const MergeInput& other) const {
    if (at() != other.at()) return at() < other.at();
    return place() < other.place();
  }

 private:
  [[nodiscard]] int place() const {
    return record_->kind == RecordKind::read ? 2 : record_->kind == RecordKind::write ? 1 : 0;
  }

  TapeReader reader_;
  Micros at_;
  std::optional<Record> record_;
  TapeTime last_{};
  bool ended_ = false;
};

class TapeMerger {
 public:
  TapeMerger(std::vector<MergeSource> sources, const TapePaths& to, const MergeOptions& options)
      : sources_(std::move(sources)), options_(options) {
    merged_.paths = to;
  }

  Result<MergedTape> run() {
    if (Result<void> placed = place(); !placed) return placed.error();
    if (Result<void> begun = begin(); !begun) return begun.error();
    do {
      if (Result<void> copied = copy_open(); !copied) return copied.error();
      inputs_.clear();
      if (waiting_ == sources_.size()) break;
      if (Result<void> opened = open_next(tape_->latest() - TapeTime{} + Micros(1)); !opened)
        return opened.error();
    } while (true);
    merged_.end = std::max(last_, tape_->latest());
    const Result<TapePaths> paths = tape_->finish(lacks_end_ ? std::nullopt : std::optional(merged_.end));
    if (!paths) return paths.error();
    merged_.paths = *paths;
    return merged_;
  }

 private:
  Result<void> place() {
    std::optional<std::vector<Micros>> offsets;
    if (!options_.offsets.empty()) {
      offsets = std::vector<Micros>{Micros{}};
      offsets->insert(offsets->end(), options_.offsets.begin(), options_.offsets.end());
      merged_.placed = MergedTape::Placed::given;
      if (offsets->size() != sources_.size())
        return make_error(Errc::usage, std::to_string(offsets->size() - 1) + " offsets are given for " +
                                           std::to_string(sources_.size() - 1) + " tapes behind the first");
    } else if ((offsets = by_parts(sources_))) {
      merged_.placed = MergedTape::Placed::parts;
    } else if ((offsets = by_clock(sources_))) {
      merged_.placed = MergedTape::Placed::clock;
    }
    if (!offsets) return {};
    const Micros earliest = *std::ranges::min_element(*offsets);
    for (std::size_t i = 0; i < sources_.size(); ++i) sources_[i].at = (*offsets)[i] - earliest;
    return {};
  }

  Result<void> open_next(Micros at) {
    Result<TapeReader> reader = TapeReader::open(sources_[waiting_].paths);
    if (!reader) return reader.error();
    ++waiting_;
    inputs_.push_back(std::make_unique<MergeInput>(std::move(*reader), at));
    return inputs_.back()->advance();
  }

  // All at once where their places are known, else the first.
  Result<void> begin() {
    const bool known = merged_.placed != MergedTape::Placed::after;
    do {
      if (Result<void> opened = open_next(sources_[waiting_].at); !opened) return opened;
    } while (known && waiting_ < sources_.size());
    const auto first = std::ranges::min_element(sources_, {}, &MergeSource::at);
    const TapeReader& reader = inputs_.at(static_cast<std::size_t>(first - sources_.begin()))->reader();
    TapeHeader header = made_of(reader.header(), first->paths.file_name(), "merge");
    if (first->header) header.zero = first->header->zero;
    if (first->header) header.previous = first->header->previous;
    header.origin->tapes.clear();
    for (const MergeSource& source : sources_)
      header.origin->tapes.push_back({source.header.value_or(TapeHeader{}).id, source.paths.file_name()});
    Result<NewTape> tape =
        NewTape::create(merged_.paths, made_line(reader.header_line(), header), options_.writer);
    if (!tape) return tape.error();
    tape_.emplace(std::move(*tape));
    return {};
  }

  // All that is open, in order.
  Result<void> copy_open() {
    for (;;) {
      MergeInput* next = nullptr;
      for (const auto& input : inputs_) {
        if (!input->over() && (next == nullptr || input->before(*next))) next = input.get();
      }
      if (next == nullptr) break;
      if (Result<void> copied = copy(*next); !copied) return copied;
    }
    for (const auto& input : inputs_) {
      lacks_end_ = lacks_end_ || input->lacks_end();
      last_ = std::max(last_, input->last());
    }
    return {};
  }

  // A record; of a block all pieces.
  Result<void> copy(MergeInput& input) {
    for (bool whole = false; !whole && !input.over();) {
      const Record& record = input.record();
      whole = record.event != nullptr || record.last_piece();
      if (options_.progress) options_.progress(bytes_ += bytes_in_file(record));
      if (is_kept(record)) {
        if (record.event != nullptr) ++merged_.events;
        if (record.event == nullptr && record.piece_offset == 0) ++merged_.blocks;
        state_.pass(record);
        if (Result<void> copied = tape_->copy(record, input.later()); !copied) return copied;
      }
      if (Result<void> advanced = input.advance(); !advanced) return advanced;
    }
    return {};
  }

  // The merged tape's zero is in its header.
  [[nodiscard]] bool is_kept(const Record& record) const {
    if (record.event == nullptr) return true;
    if (std::holds_alternative<event::Zero>(*record.event) ||
        std::holds_alternative<event::End>(*record.event))
      return false;
    return !is_carried(record.event_line) || !state_.holds(record);
  }

  std::vector<MergeSource> sources_;
  const MergeOptions& options_;
  MergedTape merged_;
  std::optional<NewTape> tape_;
  std::vector<std::unique_ptr<MergeInput>> inputs_;  // those that are open
  std::size_t waiting_ = 0;                          // the first that was not opened yet
  LineState state_;
  TapeTime last_{};
  bool lacks_end_ = false;
  std::uint64_t bytes_ = 0;
};

}  // namespace

Result<MergedTape> merge_tapes(const std::vector<TapePaths>& tapes, const TapePaths& to,
                               const MergeOptions& options) {
  std::vector<MergeSource> sources;
  for (const TapePaths& tape : tapes) {
    Result<std::optional<TapeHeader>> header = whole_header(tape);
    if (!header) return header.error();
    sources.push_back({tape, std::move(*header), {}});
  }
  if (Result<void> good = check_sources(sources); !good) return good.error();
  return TapeMerger(std::move(sources), to, options).run();
}

}  // namespace porttape
