#include "libport/infer/frame_expression.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace porttape {
namespace {

constexpr std::string_view kWord = "[-+._0-9A-Za-z]*";

std::string any_bytes(std::size_t count) {
  if (count == 0) return {};
  return count == 1 ? "." : fmt::format(".{{{}}}", count);
}

// One repeated piece as `piece{n}`.
class Pieces {
 public:
  void add(const std::string& piece) {
    if (piece == last_) {
      ++count_;
      return;
    }
    flush();
    last_ = piece;
    count_ = 1;
  }
  std::string take() {
    flush();
    return std::move(text_);
  }

 private:
  void flush() {
    if (count_ == 1) text_ += last_;
    if (count_ > 1) text_ += fmt::format("(?:{}){{{}}}", last_, count_);
    count_ = 0;
  }
  std::string text_;
  std::string last_;
  std::size_t count_ = 0;
};

const FoundField* field_of_word(const FoundKind& kind, std::size_t word) {
  const auto found = std::ranges::find_if(kind.fields, [&](const FoundField& field) {
    return field.what == FoundField::What::word && field.word == word;
  });
  return found == kind.fields.end() ? nullptr : &*found;
}

bool has_middle(const FoundKind& kind) {
  return !kind.fields.empty() && kind.fields.front().what == FoundField::What::middle;
}

// Where the first thing that may vary stands in a frame of the kind.
std::size_t first_free(const FoundSort& sort, const FoundKind& kind, ByteView frame) {
  std::size_t first = sort.body(frame).size();
  const std::string_view text = as_text(sort.body(frame));
  for (const FoundField& field : kind.fields) {
    if (field.what != FoundField::What::word) {
      first = std::min(first, field.at);
      continue;
    }
    const std::string_view word = cut_text(text).words[field.word];
    first =
        std::min(first, static_cast<std::size_t>(word.data() - text.data()) + field.pattern.before.size());
  }
  return first;
}

// What all frames of the kind begin with, up to what may vary.
Bytes common_begin(const FoundSort& sort, const FoundKind& kind) {
  std::optional<Bytes> begin;
  for (const FrameRun& run : kind.runs) {
    for (const ByteView frame : run) {
      const ByteView known = frame.first(first_free(sort, kind, frame));
      if (!begin) begin = Bytes(known.begin(), known.end());
      begin->erase(std::ranges::mismatch(*begin, known).in1, begin->end());
    }
  }
  return begin.value_or(Bytes{});
}

bool begins_any(const Findings& findings, const FoundKind& but, ByteView begin) {
  return std::ranges::any_of(findings.kinds, [&](const FoundKind& kind) {
    if (&kind == &but || kind.sort != but.sort) return false;
    return std::ranges::any_of(kind.runs, [&](const FrameRun& run) {
      return std::ranges::any_of(run, [&](ByteView frame) {
        return frame.size() >= begin.size() && std::ranges::equal(frame.first(begin.size()), begin);
      });
    });
  });
}

std::string text_kind_expression(const Findings& findings, const FoundKind& kind) {
  const FoundSort& sort = findings.sorts[kind.sort];
  const Bytes begin = common_begin(sort, kind);
  if (!kind.marks || !begins_any(findings, kind, begin)) return "^" + literal_expression(begin);
  Pieces pieces;
  pieces.add("^" + literal_expression(begin) + std::string(kWord));
  const auto begun = static_cast<std::size_t>(
      std::ranges::count_if(cut_text(as_text(begin)).marks, [](char) { return true; }));
  for (std::size_t mark = begun; mark < kind.marks->size(); ++mark)
    pieces.add(literal_expression(as_bytes(std::string_view(*kind.marks).substr(mark, 1))) +
               std::string(kWord));
  const auto run = std::ranges::find_if(kind.runs, [](const FrameRun& each) { return !each.empty(); });
  return pieces.take() + any_bytes(run->front().size() - sort.body(run->front()).size()) + "$";
}

std::string binary_kind_expression(const Findings& findings, const FoundKind& kind) {
  const FoundSort& sort = findings.sorts[kind.sort];
  const Bytes& start = sort.sort.format.start;
  std::string expression = "^";
  std::size_t known = 0;
  if (!start.empty() && kind.key_at >= start.size()) {
    expression += literal_expression(start);
    known = start.size();
  }
  if (!kind.key.empty()) {
    expression += any_bytes(kind.key_at - known) + literal_expression(kind.key);
    known = kind.key_at + kind.key.size();
  }
  const bool alike = std::ranges::any_of(findings.kinds, [&](const FoundKind& other) {
    return &other != &kind && other.sort == kind.sort && other.key == kind.key;
  });
  if (alike && kind.size && *kind.size >= known) expression += any_bytes(*kind.size - known) + "$";
  return expression == "^" ? "" : expression;
}

// The bytes, but for those that may vary: the kind's fields, counters, and with a middle the length.
std::string head_expression(const FoundSort& sort, const FoundKind& kind, ByteView bytes) {
  const FrameFormat& format = sort.sort.format;
  const auto length_at = static_cast<std::size_t>(format.length.at);
  const bool any_length = has_middle(kind) && format.kind == FrameFormat::Kind::length;
  const auto is_free = [&](std::size_t at) {
    const auto has = [&](const FoundField& field) { return at >= field.at && at < field.at + field.size; };
    const bool in_length = at >= length_at && at < length_at + static_cast<std::size_t>(format.length.size);
    return (any_length && in_length) || std::ranges::any_of(kind.fields, has) ||
           std::ranges::any_of(sort.counters, has);
  };
  std::string out;
  for (std::size_t at = 0; at < bytes.size();) {
    std::size_t free = 0;
    while (at + free < bytes.size() && is_free(at + free)) ++free;
    out += free > 0 ? any_bytes(free) : literal_expression(bytes.subspan(at, 1));
    at += std::max<std::size_t>(free, 1);
  }
  return out;
}

}  // namespace

std::string literal_expression(ByteView bytes) {
  std::string out;
  for (const Byte byte : bytes) {
    const char character = static_cast<char>(byte);
    const bool plain = (byte >= '0' && byte <= '9') || (byte >= 'a' && byte <= 'z') ||
                       (byte >= 'A' && byte <= 'Z') ||
                       std::string_view(" ,;:=#%&/_<>@!~\"-").find(character) != std::string_view::npos;
    const bool printable = byte > 0x20 && byte < 0x7f && byte != '\'';
    if (plain) {
      out += character;
    } else if (printable) {
      out += fmt::format("\\{}", character);
    } else {
      out += fmt::format("\\x{:02x}", byte);
    }
  }
  return out;
}

std::string kind_expression(const Findings& findings, const FoundKind& kind) {
  return findings.sorts[kind.sort].sort.text ? text_kind_expression(findings, kind)
                                             : binary_kind_expression(findings, kind);
}

std::string word_expression(const FoundKind& kind, const FoundField& field) {
  Pieces pieces;
  for (std::size_t word = 0; word < field.word; ++word)
    pieces.add(std::string(kWord) +
               literal_expression(as_bytes(std::string_view(*kind.marks).substr(word, 1))));
  const std::string behind =
      field.pattern.behind.empty() ? "" : literal_expression(as_bytes(field.pattern.behind));
  return "^" + pieces.take() + literal_expression(as_bytes(field.pattern.before)) + "(" +
         regex_of(field.pattern) + ")" + behind;
}

std::string frame_expression(const FoundSort& sort, const FoundKind& kind, ByteView frame) {
  const ByteView body = sort.body(frame);
  const bool varies = !kind.fields.empty() || !sort.counters.empty();
  std::string out = "^";
  if (kind.marks && !kind.fields.empty()) {
    const TextParts parts = cut_text(as_text(body));
    for (std::size_t word = 0; word < parts.words.size(); ++word) {
      const FoundField* field = field_of_word(kind, word);
      const bool free = field != nullptr && field->pattern.matches(parts.words[word]);
      out += free ? literal_expression(as_bytes(field->pattern.before)) + regex_of(field->pattern) +
                        literal_expression(as_bytes(field->pattern.behind))
                  : literal_expression(as_bytes(parts.words[word]));
      if (word < parts.marks.size())
        out += literal_expression(as_bytes(std::string_view(parts.marks).substr(word, 1)));
    }
  } else {
    const bool middle = has_middle(kind);
    const std::size_t head = middle ? kind.fields.front().at : body.size();
    out += head_expression(sort, kind, body.first(head));
    if (middle) out += ".*" + literal_expression(body.last(kind.fields.front().tail));
  }
  const std::size_t tail = frame.size() - body.size();
  return out + (varies ? any_bytes(tail) : literal_expression(frame.last(tail))) + "$";
}

}  // namespace porttape
