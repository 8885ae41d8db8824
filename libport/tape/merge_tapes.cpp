#include "libport/tape/merge_tapes.hpp"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "libport/tape/tape_group.hpp"

namespace porttape {
namespace {

class TapeMerger {
 public:
  TapeMerger(std::vector<GroupedTape> sources, const TapePaths& to, const MergeOptions& options)
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
    const Result<TapePaths> paths =
        tape_->finish(lacks_end_ || !merged_.halves.empty() ? std::nullopt : std::optional(merged_.end));
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
    } else if ((offsets = begins_by_parts(sources_))) {
      merged_.placed = MergedTape::Placed::parts;
    } else if ((offsets = begins_by_clock(sources_))) {
      merged_.placed = MergedTape::Placed::clock;
    }
    if (offsets) place_tapes(sources_, *offsets);
    return {};
  }

  Result<void> open_next(Micros at) {
    Result<TapeReader> reader = TapeReader::open(sources_[waiting_].paths);
    if (!reader) return reader.error();
    ++waiting_;
    inputs_.push_back(std::make_unique<GroupInput>(std::move(*reader), at));
    return inputs_.back()->advance();
  }

  // All at once where their places are known, else the first.
  Result<void> begin() {
    const bool known = merged_.placed != MergedTape::Placed::after;
    do {
      if (Result<void> opened = open_next(sources_[waiting_].at); !opened) return opened;
    } while (known && waiting_ < sources_.size());
    const auto first = std::ranges::min_element(sources_, {}, &GroupedTape::at);
    const TapeReader& reader = inputs_.at(static_cast<std::size_t>(first - sources_.begin()))->reader();
    TapeHeader header = made_of(reader.header(), first->paths.file_name(), "merge");
    if (first->header) header.zero = first->header->zero;
    if (first->header) header.previous = first->header->previous;
    header.origin->tapes.clear();
    for (const GroupedTape& source : sources_)
      header.origin->tapes.push_back({source.header.value_or(TapeHeader{}).id, source.paths.file_name()});
    Result<NewTape> tape =
        NewTape::create(merged_.paths, made_line(reader.header_line(), header), options_.writer);
    if (!tape) return tape.error();
    tape_.emplace(std::move(*tape));
    return {};
  }

  // All that is open, in order.
  Result<void> copy_open() {
    while (GroupInput* const next = earliest_of(inputs_)) {
      if (Result<void> copied = copy(*next); !copied) return copied;
    }
    for (const auto& input : inputs_) {
      lacks_end_ = lacks_end_ || input->lacks_end();
      if (const auto half = input->reader().half()) merged_.halves.push_back(*half);
      last_ = std::max(last_, input->last());
    }
    return {};
  }

  // A record; of a block all pieces.
  Result<void> copy(GroupInput& input) {
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

  std::vector<GroupedTape> sources_;
  const MergeOptions& options_;
  MergedTape merged_;
  std::optional<NewTape> tape_;
  std::vector<std::unique_ptr<GroupInput>> inputs_;  // those that are open
  std::size_t waiting_ = 0;                          // the first that was not opened yet
  LineState state_;
  TapeTime last_{};
  bool lacks_end_ = false;
  std::uint64_t bytes_ = 0;
};

}  // namespace

Result<MergedTape> merge_tapes(const std::vector<TapePaths>& tapes, const TapePaths& to,
                               const MergeOptions& options) {
  Result<std::vector<GroupedTape>> sources = grouped_tapes(tapes);
  if (!sources) return sources.error();
  return TapeMerger(std::move(*sources), to, options).run();
}

}  // namespace porttape
