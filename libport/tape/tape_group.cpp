#include "libport/tape/tape_group.hpp"

#include <algorithm>
#include <string>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

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

bool has_same_id(const GroupedTape& one, const GroupedTape& other) {
  return one.header && other.header && !one.header->id.empty() && one.header->id == other.header->id;
}

// Why the two do not go together.
std::optional<Error> check_apart(const GroupedTape& one, const GroupedTape& other) {
  const std::string name = in_quotes(other.paths.name());
  if (one.paths == other.paths) return make_error(Errc::usage, name + " is given twice");
  if (!has_same_id(one, other)) return std::nullopt;
  return make_error(Errc::usage, name + " has the same id as " + in_quotes(one.paths.name()) +
                                     ": one is a copy of the other; give one of them, or of one a cut, which "
                                     "has an id of its own (porttape cut TAPE --from 0 -o NAME)");
}

int place_among_equal(const Record& record) {
  return record.kind == RecordKind::read ? 2 : record.kind == RecordKind::write ? 1 : 0;
}

}  // namespace

Result<std::vector<GroupedTape>> grouped_tapes(const std::vector<TapePaths>& tapes) {
  std::vector<GroupedTape> grouped;
  for (const TapePaths& tape : tapes) {
    Result<std::optional<TapeHeader>> header = whole_header(tape);
    if (!header) return header.error();
    GroupedTape next{tape, std::move(*header), {}};
    for (const GroupedTape& each : grouped) {
      if (const auto wrong = check_apart(each, next)) return *wrong;
    }
    grouped.push_back(std::move(next));
  }
  return grouped;
}

std::optional<std::vector<Micros>> begins_by_clock(std::span<const GroupedTape> tapes) {
  std::vector<Micros> begins;
  for (const GroupedTape& tape : tapes) {
    const auto& first = tapes.front().header;
    const bool clocks = first && first->zero && tape.header && tape.header->zero;
    if (!clocks || first->zero->boot.empty() || first->zero->boot != tape.header->zero->boot)
      return std::nullopt;
    const auto later = since(*first->zero, *tape.header->zero);
    if (!later) return std::nullopt;
    begins.push_back(*later);
  }
  return begins;
}

std::optional<std::vector<Micros>> begins_by_parts(std::span<const GroupedTape> tapes) {
  std::vector<Micros> begins;
  for (const GroupedTape& tape : tapes) {
    const auto& first = tapes.front().header;
    const auto& origin = tape.header ? tape.header->origin : std::nullopt;
    if (!origin || origin->by != "split" || !origin->from || !first->origin ||
        origin->tapes != first->origin->tapes)
      return std::nullopt;
    begins.push_back(*origin->from - first->origin->from.value_or(Micros{}));
  }
  return begins;
}

void place_tapes(std::span<GroupedTape> tapes, std::span<const Micros> begins) {
  const Micros earliest = *std::ranges::min_element(begins);
  for (std::size_t i = 0; i < tapes.size(); ++i) tapes[i].at = begins[i] - earliest;
}

Result<void> GroupInput::advance() {
  record_.reset();
  const Result<std::optional<Record>> next = reader_.next();
  if (!next) return next.error();
  record_ = *next;
  if (!record_) return {};
  ended_ = record_->event != nullptr && std::holds_alternative<event::End>(*record_->event);
  last_ = at();
  return {};
}

bool GroupInput::before(const GroupInput& other) const {
  if (at() != other.at()) return at() < other.at();
  return place_among_equal(*record_) < place_among_equal(*other.record_);
}

GroupInput* earliest_of(std::span<const std::unique_ptr<GroupInput>> inputs) {
  GroupInput* next = nullptr;
  for (const auto& input : inputs) {
    if (!input->over() && (next == nullptr || input->before(*next))) next = input.get();
  }
  return next;
}

}  // namespace porttape
