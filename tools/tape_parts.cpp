#include "tools/tape_parts.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {
namespace {

bool is_block(RecordKind kind) { return kind == RecordKind::read || kind == RecordKind::write; }

}  // namespace

Result<TapeParts> TapeParts::load(const TapePaths& tape) {
  Result<TapeReader> reader = TapeReader::open(tape);
  if (!reader) return reader.error();
  TapeParts all;
  all.name_ = tape.file_name();
  std::uint64_t bytes = 0;
  bool requests = false;  // the last block is a write
  for (;;) {
    const Result<std::optional<Record>> next = reader->next();
    if (!next) return next.error();
    if (!*next) break;
    const Record& record = **next;
    const bool block = is_block(record.kind);
    if (block && record.piece_offset > 0) {
      all.steps_.back().data.insert(all.steps_.back().data.end(), record.data.begin(), record.data.end());
    } else {
      all.steps_.push_back(
          {.kind = record.kind, .at = record.at, .data = {}, .event = {}, .line = {}, .part = {}});
      if (block) all.steps_.back().data.assign(record.data.begin(), record.data.end());
      if (record.event != nullptr) all.steps_.back().event = *record.event;
      all.steps_.back().line = record.event_line;
    }
    bytes += record.data.size();
    if (bytes > kMostBytes)
      return make_error(Errc::usage,
                        fmt::format("{} has more than {} MiB of data", tape.name(), kMostBytes >> 20U));
    if (block) {
      const bool writes = record.kind == RecordKind::write;
      const bool begins = writes ? !requests : all.parts_.empty() || all.parts_.back().request.empty();
      if (begins && record.piece_offset == 0) all.parts_.emplace_back();
      Part& part = all.parts_.back();
      if (writes) part.request.insert(part.request.end(), record.data.begin(), record.data.end());
      if (!writes) part.read += record.data.size();
      if (!writes) all.read_bytes_ += record.data.size();
      requests = writes;
    }
    const bool of_line = !block && !is_note(record.kind);
    if (record.kind == RecordKind::open || record.kind == RecordKind::close) requests = false;
    if (!of_line && !all.parts_.empty()) all.steps_.back().part = all.parts_.size() - 1;
  }
  all.header_ = reader->header();
  return all;
}

std::vector<const TapeParts::Step*> TapeParts::steps_of(const std::vector<std::size_t>& kept) const {
  std::vector<const Step*> steps;
  for (const Step& step : steps_) {
    const bool stays = !step.part || std::ranges::binary_search(kept, *step.part);
    const bool ends = step.event && std::holds_alternative<event::End>(*step.event);
    if (!stays || ends) continue;
    const bool empty_session =
        step.kind == RecordKind::close && steps.size() > 1 && steps.back()->kind == RecordKind::open;
    if (empty_session) {
      steps.pop_back();
    } else {
      steps.push_back(&step);
    }
  }
  return steps;
}

Result<void> TapeParts::write(const TapePaths& tape, const std::vector<std::size_t>& kept, bool sync) const {
  TapeHeader header = header_.value_or(TapeHeader{});
  if (!header.id.empty()) header.previous = PreviousTape{header.id, name_};
  header.id.clear();
  header.created.clear();
  if (!header.stamped) header.stamped = header_ ? Stamped::arrival : Stamped::read;
  Result<TapeWriter> writer = TapeWriter::create(tape, header, {.sync = sync});
  if (!writer) return writer.error();
  Micros out{};  // the time that was taken out
  const std::vector<const Step*> steps = steps_of(kept);
  std::size_t next = 0;
  TapeTime last{};
  TapeTime before{};  // of the step before, on the whole tape
  for (const Step& step : steps_) {
    const bool stays = next < steps.size() && steps[next] == &step;
    if (!stays) out += step.at - before;
    before = step.at;
    if (!stays) continue;
    ++next;
    last = step.at - out;
    if (is_block(step.kind)) {
      writer->block(step.kind == RecordKind::read ? Direction::read : Direction::write, last, step.data);
    } else if (const auto* gap = std::get_if<event::Gap>(&*step.event)) {
      writer->event(last, event::Gap{gap->bytes, std::nullopt, gap->why});
    } else {
      writer->event_line(last, step.line);
    }
  }
  return writer->finish(last);
}

}  // namespace porttape
