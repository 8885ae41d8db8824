#include "libport/infer/kind_fields.hpp"

#include <algorithm>

namespace porttape {
namespace {

using What = FoundField::What;

std::vector<FrameRun> bodies_of(const FoundSort& sort, std::span<const FrameRun> runs) {
  std::vector<FrameRun> bodies;
  for (const FrameRun& run : runs) {
    FrameRun& row = bodies.emplace_back();
    for (const ByteView frame : run) row.push_back(sort.body(frame));
  }
  return bodies;
}

// Bodies side by side.
std::vector<Compared> bodies_of_columns(const FoundSort& sort, std::span<const Compared> columns) {
  return bodies_of(sort, columns);
}

bool differs_at(const Compared& column, std::size_t at) {
  return std::ranges::any_of(column, [&](ByteView frame) {
    return frame.size() <= at || column.front().size() <= at || frame[at] != column.front()[at];
  });
}

std::size_t places(std::span<const Compared> columns, std::size_t at, std::size_t size) {
  return static_cast<std::size_t>(std::ranges::count_if(columns, [&](const Compared& column) {
    for (std::size_t i = at; i < at + size; ++i)
      if (differs_at(column, i)) return true;
    return false;
  }));
}

bool in_length(const FrameFormat& format, std::size_t at) {
  const auto begin = static_cast<std::size_t>(format.length.at);
  return format.kind == FrameFormat::Kind::length && at >= begin &&
         at < begin + static_cast<std::size_t>(format.length.size);
}

bool overlaps(const FoundField& field, std::size_t at, std::size_t size) {
  return at < field.at + field.size && field.at < at + size;
}

// Whether a byte that differs there needs no explanation.
bool explained(const FoundSort& sort, std::span<const FoundField> fields, std::size_t at) {
  const auto has = [&](const FoundField& field) { return overlaps(field, at, 1); };
  return in_length(sort.sort.format, at) || std::ranges::any_of(sort.counters, has) ||
         std::ranges::any_of(fields, has);
}

std::vector<FoundField> counters_in(const FoundSort& sort, std::span<const FrameRun> runs) {
  std::vector<FoundField> fields;
  for (const CounterPlace& counter : find_counters(runs)) {
    bool taken = false;
    for (std::size_t at = counter.offset; at < counter.offset + counter.size; ++at)
      taken = taken || explained(sort, {}, at);
    if (taken) continue;
    FoundField field{.what = What::counter, .at = counter.offset, .size = counter.size};
    field.little_endian = counter.little_endian;
    field.step = counter.step;
    fields.push_back(field);
  }
  return fields;
}

void keep_differing(std::vector<FoundField>& counters, std::span<const Compared> columns) {
  for (FoundField& counter : counters) counter.places = places(columns, counter.at, counter.size);
  std::erase_if(counters, [](const FoundField& counter) { return counter.places == 0; });
}

void find_bytes(const FoundSort& sort, std::span<const Compared> columns, std::size_t size,
                std::vector<FoundField>& fields) {
  const std::vector<FoundField> counters = fields;
  std::optional<FoundField> open;
  for (std::size_t at = 0; at <= size; ++at) {
    const bool differs = at < size && !explained(sort, counters, at) && places(columns, at, 1) > 0;
    if (differs && !open) open = FoundField{.what = What::bytes, .at = at};
    if (differs) ++open->size;
    if (differs || !open) continue;
    open->places = places(columns, open->at, open->size);
    fields.push_back(*open);
    open.reset();
  }
}

// How far two bodies are the same from the front, and from behind.
std::size_t same_head(const FoundSort& sort, ByteView a, ByteView b) {
  std::size_t at = 0;
  while (at < std::min(a.size(), b.size()) && (a[at] == b[at] || explained(sort, {}, at))) ++at;
  return at;
}
std::size_t same_tail(ByteView a, ByteView b, std::size_t head) {
  std::size_t size = 0;
  while (head + size < std::min(a.size(), b.size()) && a[a.size() - 1 - size] == b[b.size() - 1 - size])
    ++size;
  return size;
}

bool is_word(Byte byte) {
  return (byte >= '0' && byte <= '9') || (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z');
}

void find_middle(const FoundSort& sort, std::span<const Compared> columns, std::vector<FoundField>& fields) {
  FoundField field{.what = What::middle, .at = ~std::size_t{0}, .tail = ~std::size_t{0}};
  for (const Compared& column : columns) {
    if (std::ranges::all_of(column, [&](ByteView body) { return std::ranges::equal(body, column.front()); }))
      continue;
    ++field.places;
    for (const ByteView body : column) field.at = std::min(field.at, same_head(sort, column.front(), body));
  }
  if (field.places == 0) return;
  while (sort.sort.text && field.at > 0 && is_word(columns.front().front()[field.at - 1])) --field.at;
  for (const Compared& column : columns) {
    for (const ByteView body : column) {
      if (std::ranges::equal(body, column.front())) continue;
      field.tail = std::min(field.tail, same_tail(column.front(), body, field.at));
    }
  }
  field.shortest = ~std::size_t{0};
  for (const Compared& column : columns) {
    for (const ByteView body : column) {
      const std::size_t size = body.size() - std::min(body.size(), field.at + field.tail);
      field.shortest = std::min(field.shortest, size);
      field.longest = std::max(field.longest, size);
    }
  }
  fields.push_back(field);
}

// Word number `word` of each text.
std::vector<std::vector<std::string_view>> words_of(std::span<const FrameRun> bodies, std::size_t word) {
  std::vector<std::vector<std::string_view>> all;
  for (const FrameRun& run : bodies) {
    auto& row = all.emplace_back();
    for (const ByteView body : run) row.push_back(cut_text(as_text(body)).words[word]);
  }
  return all;
}

// The parts of these words that differ, if all words have the pattern.
std::optional<std::vector<std::vector<std::string_view>>> free_parts(
    const WordPattern& pattern, std::vector<std::vector<std::string_view>> words) {
  for (auto& row : words) {
    for (std::string_view& word : row) {
      if (!pattern.matches(word)) return std::nullopt;
      word = pattern.free_part(word);
    }
  }
  return words;
}

void find_word(std::span<const FrameRun> bodies, std::span<const Compared> columns, std::size_t word,
               std::vector<FoundField>& fields) {
  std::vector<std::string_view> differing;
  FoundField field{.what = What::word};
  for (const auto& row : words_of(columns, word)) {
    if (std::ranges::all_of(row, [&](std::string_view each) { return each == row.front(); })) continue;
    differing.insert(differing.end(), row.begin(), row.end());
    ++field.places;
  }
  if (field.places == 0) return;
  field.word = word;
  field.pattern = find_pattern(differing);
  field.shortest = ~std::size_t{0};
  for (const std::string_view each : differing) {
    const std::size_t size = field.pattern.free_part(each).size();
    field.shortest = std::min(field.shortest, size);
    field.longest = std::max(field.longest, size);
  }
  if (const auto parts = free_parts(field.pattern, words_of(bodies, word))) {
    if (const auto counter = find_text_counter(*parts)) {
      field.step = counter->step;
      field.base = counter->base;
    }
  }
  fields.push_back(std::move(field));
}

}  // namespace

void find_sort_counters(FoundSort& sort, std::span<const FrameRun> runs) {
  if (!sort.sort.text) sort.counters = counters_in(sort, bodies_of(sort, runs));
}

void keep_differing_counters(FoundSort& sort, std::span<const Compared> columns) {
  keep_differing(sort.counters, bodies_of_columns(sort, columns));
}

void find_fields(const FoundSort& sort, KindColumns& kind) {
  const std::vector<Compared> columns = bodies_of_columns(sort, kind.columns);
  if (columns.empty()) return;
  std::vector<FoundField>& fields = kind.kind.fields;
  if (kind.kind.marks) {
    const std::vector<FrameRun> bodies = bodies_of(sort, kind.kind.runs);
    for (std::size_t word = 0; word <= kind.kind.marks->size(); ++word)
      find_word(bodies, columns, word, fields);
  } else if (kind.kind.size) {
    fields = counters_in(sort, bodies_of(sort, kind.kind.runs));
    keep_differing(fields, columns);
    find_bytes(sort, columns, columns.front().front().size(), fields);
  } else {
    find_middle(sort, columns, fields);
  }
}

}  // namespace porttape
