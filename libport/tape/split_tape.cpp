#include "libport/tape/split_tape.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"
#include "libport/tape/tape_set.hpp"

namespace porttape {
namespace {

// Where the parts of a tape begin, told its records in order.
class SplitPlaces {
 public:
  SplitPlaces(SplitOptions::At at, Micros span) : at_(at), span_(span) {}

  // The beginning of the part that begins with this record; nothing where none does.
  std::optional<TapeTime> begins(const Record& record) {
    const TapeTime before = std::exchange(last_, record.at);
    const bool first = !std::exchange(any_, true);
    const bool another = begins_another(record, before);
    if (first) return TapeTime{};
    if (!another) return std::nullopt;
    return begin_of(record);
  }

 private:
  [[nodiscard]] TapeTime begin_of(const Record& record) const {
    if (at_ != SplitOptions::At::every) return record.at;
    return record.at - (record.at - TapeTime{}) % span_;
  }

  bool begins_another(const Record& record, TapeTime before) {
    switch (at_) {
      case SplitOptions::At::session:
        return record.kind == RecordKind::open && std::exchange(opened_, true);
      case SplitOptions::At::mark:
        return record.event != nullptr && std::holds_alternative<event::Mark>(*record.event);
      case SplitOptions::At::every:
        return (record.at - TapeTime{}) / span_ != (before - TapeTime{}) / span_;
      case SplitOptions::At::gap:
        break;
    }
    return record.at - before >= span_;
  }

  SplitOptions::At at_;
  Micros span_;
  TapeTime last_{};
  bool any_ = false;
  bool opened_ = false;
};

class TapeSplitter {
 public:
  TapeSplitter(TapeReader& reader, std::string name, const TapePaths& to, const SplitOptions& options)
      : reader_(reader),
        name_(std::move(name)),
        to_(to),
        options_(options),
        places_(options.at, options.span) {}

  Result<std::vector<SplitPart>> run() {
    Result<TapeSet> set = TapeSet::begin(to_, options_.writer.on_existing);
    if (!set) return set.error();
    made_.emplace(std::move(*set));
    Result<void> done = all();
    if (done) done = made_->publish();
    if (!done) return done.error();
    return std::move(parts_);
  }

 private:
  Result<void> all() {
    if (Result<void> looked = look_at_whole(); !looked) return looked;
    bool ended = false;
    TapeTime last{};
    for (;;) {
      const Result<std::optional<Record>> next = reader_.next();
      if (!next) return next.error();
      if (!*next) break;
      const Record& record = **next;
      if (options_.progress) options_.progress(bytes_ += bytes_in_file(record));
      last = record.at;
      ended = record.event != nullptr && std::holds_alternative<event::End>(*record.event);
      if (ended) continue;
      if (Result<void> taken = take(record); !taken) return taken;
    }
    if (!part_) return make_error(Errc::usage, in_quotes(name_) + " is empty; nothing is made of it");
    return finish(ended || !reader_.has_events() ? std::optional(std::max(last, part_->latest()))
                                                 : std::nullopt);
  }

  // What a tape without events lacks shows at its end, and may be missing in any part.
  Result<void> look_at_whole() {
    if (reader_.has_events()) return {};
    for (;;) {
      const Result<std::optional<Record>> next = reader_.next();
      if (!next) return next.error();
      if (!*next) break;
    }
    half_ = reader_.half();
    return reader_.rewind();
  }

  Result<void> take(const Record& record) {
    if (record.piece_offset == 0) {
      if (const auto from = places_.begins(record)) {
        if (Result<void> begun = begin(*from); !begun) return begun;
      }
      state_.pass(record);
      SplitPart& part = parts_.back();
      part.to = record.at;
      ++(record.event != nullptr ? part.events : part.blocks);
    }
    return part_->copy(record);
  }

  Result<void> begin(TapeTime from) {
    std::optional<PreviousTape> previous;
    if (part_) {
      previous = PreviousTape{part_->id(), part_tape(to_, parts_.size()).file_name()};
      if (Result<void> finished = finish(part_->latest()); !finished) return finished;
    } else if (const auto header = reader_.header()) {
      previous = header->previous;
    }
    const Result<TapePaths> place = made_->place(part_tape(to_, parts_.size() + 1));
    if (!place) return place.error();
    Result<PartWriter> part = PartWriter::begin(reader_, state_,
                                                {.to = *place,
                                                 .writer = options_.writer,
                                                 .by = "split",
                                                 .name = name_,
                                                 .from = from,
                                                 .rebased = true,
                                                 .previous = std::move(previous)});
    if (!part) return part.error();
    part_.emplace(std::move(*part));
    parts_.push_back({from, from, 0, 0, half_});
    return {};
  }

  Result<void> finish(std::optional<TapeTime> end) {
    const Result<TapePaths> finished = part_->finish(half_ ? std::nullopt : end);
    return finished ? Result<void>() : Result<void>(finished.error());
  }

  TapeReader& reader_;
  std::optional<std::string> half_;
  std::string name_;
  TapePaths to_;
  const SplitOptions& options_;
  SplitPlaces places_;
  LineState state_;
  std::optional<PartWriter> part_;
  std::vector<SplitPart> parts_;
  std::optional<TapeSet> made_;
  std::uint64_t bytes_ = 0;
};

}  // namespace

Result<std::vector<SplitPart>> split_tape(const TapePaths& from, const TapePaths& to,
                                          const SplitOptions& options) {
  Result<TapeReader> reader = TapeReader::open(from);
  if (!reader) return reader.error();
  return TapeSplitter(*reader, from.file_name(), to, options).run();
}

}  // namespace porttape
