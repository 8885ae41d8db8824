#include "libport/formats/text_format.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/formats/byte_text.hpp"
#include "libport/formats/each_record.hpp"
#include "libport/formats/line_import.hpp"

namespace porttape {
namespace {

constexpr std::string_view kFirstLine = "porttape-text 1";
constexpr std::string_view kTimeKey = "{\"t_us\":";
constexpr std::string_view kHeader = "header ";
constexpr std::size_t kHexOfLine = 16;
constexpr std::size_t kCharsOfLine = 80;
constexpr std::string_view kGuide =
    "# A line: +SECONDS (after the line before) or SECONDS (since the tape's zero), then\n"
    "#   w or r and bytes (w: the driver writes, r: it reads): \"text\\r\\n\" or hexadecimal digits; more\n"
    "#     of them on lines that begin with a space; without bytes the block is empty\n"
    "#   open, close, mark \"text\", end, or event {\"event\":…} as on the tape\n"
    "# To make a tape of it: porttape convert THIS -o NAME\n";

bool is_space(char c) { return c == ' ' || c == '\t'; }

// A line of the text with the place in it.
class LineText {
 public:
  explicit LineText(std::string_view line) : line_(line), left_(line) {}

  void skip_spaces() {
    while (!left_.empty() && is_space(left_.front())) left_.remove_prefix(1);
  }
  // At its end, or a comment's begin.
  bool over() {
    skip_spaces();
    return left_.empty() || left_.front() == '#';
  }
  std::string_view word() {
    skip_spaces();
    const std::size_t size = std::min(left_.find_first_of(" \t#\""), left_.size());
    const std::string_view word = left_.substr(0, size);
    left_.remove_prefix(size);
    return word;
  }
  // A text in quotes, without them; nothing where its end is missing.
  std::optional<std::string_view> quoted() {
    for (std::size_t i = 1; i < left_.size(); ++i) {
      if (left_[i] == '\\') {
        ++i;
      } else if (left_[i] == '"') {
        const std::string_view text = left_.substr(1, i - 1);
        left_.remove_prefix(i + 1);
        return text;
      }
    }
    return std::nullopt;
  }
  std::string_view rest() { return std::exchange(left_, {}); }

  [[nodiscard]] std::size_t column() const { return line_.size() - left_.size(); }
  [[nodiscard]] char next() const { return left_.front(); }
  std::string_view& left() { return left_; }

 private:
  std::string_view line_;
  std::string_view left_;
};

class TextImport final : public LineImport {
 public:
  TextImport(Evidence& from, ImportTape& to) : LineImport(from, to) {}

 private:
  Result<void> at_end() override {
    if (begun_) return put_block();
    return make_error(Errc::not_a_tape,
                      evidence().name() + " is empty; its first line is \"" + std::string(kFirstLine) + "\"");
  }

  Result<void> take_line() override {
    std::string_view text = line().text;
    if (!begun_) {
      if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
      if (text != kFirstLine)
        return make_error(Errc::not_a_tape,
                          fmt::format("{}:1: not a tape's text: its first line is not \"{}\"",
                                      evidence().name(), kFirstLine));
      begun_ = true;
      tape().sure();
      return {};
    }
    LineText words(text);
    if (words.over()) return {};
    if (is_space(text.front())) return more_bytes(words);
    if (Result<void> begun = begin_record(); !begun) return begun;
    if (text.starts_with(kHeader)) return take_header(text.substr(kHeader.size()), kHeader.size());
    return take_record(words);
  }

  Result<void> take_record(LineText& words) {
    const bool relative = words.next() == '+';
    if (relative) words.left().remove_prefix(1);
    const auto us = take_seconds_us(words.left());
    if (!us || (!words.left().empty() && !is_space(words.next())))
      return wrong(words.column(),
                   "a time is expected, in seconds with up to 6 decimals: +0.000345 after the line before, "
                   "or 12.000345 since the tape's zero");
    const std::int64_t last = to_us(at_);
    if (!relative && *us < last)
      return wrong(0, fmt::format("the time goes back: {} s comes after {} s", seconds_of_us(*us),
                                  seconds_of_us(last)));
    if (relative && *us > kLatest - last) return wrong(0, "the time is over 136 years");
    at_ = tape_time_us(relative ? last + *us : *us);
    return take_kind(words);
  }

  Result<void> take_kind(LineText& words) {
    words.skip_spaces();
    const std::size_t column = words.column();
    const std::string_view kind = words.word();
    if (kind == "r" || kind == "w") {
      begin_block(kind == "r" ? Direction::read : Direction::write, at_);
      return more_bytes(words);
    }
    if (kind == "event") return take_object(words);
    if (kind == "mark") return take_mark(words);
    if (kind == "open") return ended(words, event::Open{});
    if (kind == "close") return ended(words, event::Close{});
    if (kind == "end") {
      end_at(at_);
      return nothing_more(words);
    }
    return wrong(
        column, fmt::format("{} is unknown; accepted: r, w, open, close, mark, event, end", in_quotes(kind)));
  }

  Result<void> nothing_more(LineText& words) {
    if (words.over()) return {};
    return wrong(words.column(), "something behind the line's end; a comment begins with #");
  }
  Result<void> ended(LineText& words, const Event& event) {
    if (Result<void> over = nothing_more(words); !over) return over;
    return placed(tape().event(at_, event));
  }
  Result<void> take_mark(LineText& words) {
    words.skip_spaces();
    const std::size_t column = words.column();
    const auto text = words.over() || words.next() != '"' ? std::nullopt : words.quoted();
    if (!text) return wrong(column, "a text in quotes is expected: mark \"begin\"");
    std::size_t wrong_at = 0;
    const auto bytes = unescaped_bytes(*text, wrong_at);
    if (!bytes) return wrong(column + 1 + wrong_at, kEscapes);
    return ended(words, event::Mark{std::string(bytes->begin(), bytes->end())});
  }

  Result<void> take_object(LineText& words) {
    words.skip_spaces();
    const std::size_t column = words.column();
    std::string line(words.rest());
    if (line.starts_with('{') && line.find("\"t_us\"") == std::string::npos)
      line = fmt::format("{}{}{}{}", kTimeKey, to_us(at_), line == "{}" ? "" : ",", line.substr(1));
    return take_event(at_, line, column);
  }

  // Of the block that has begun.
  Result<void> more_bytes(LineText& words) {
    if (!in_block())
      return wrong(words.column(), "bytes without a block: a line that goes on begins with a space");
    while (!words.over()) {
      const std::size_t column = words.column();
      std::optional<Bytes> bytes;
      if (words.next() == '"') {
        const auto text = words.quoted();
        if (!text) return wrong(column, "the text's closing quote is missing");
        std::size_t wrong_at = 0;
        bytes = unescaped_bytes(*text, wrong_at);
        if (!bytes) return wrong(column + 1 + wrong_at, kEscapes);
      } else {
        bytes = bytes_of_hex(words.word());
        if (!bytes || bytes->empty())
          return wrong(column, "bytes are expected: \"text\" in quotes, or pairs of hexadecimal digits");
      }
      if (Result<void> added = add_to_block(*bytes, column); !added) return added;
    }
    return {};
  }

  static constexpr const char* kEscapes = "no such escape; there are \\n \\r \\t \\e \\\\ \\\" \\xHH";
  static constexpr std::int64_t kLatest = 4'294'967'295'000'000;

  bool begun_ = false;
  TapeTime at_{};
};

bool is_plain(ByteView bytes) {
  const auto strange = std::ranges::count_if(
      bytes, [](Byte b) { return (b < 0x20 && b != '\n' && b != '\r' && b != '\t') || b >= 0x7f; });
  return static_cast<std::size_t>(strange) * 8 <= bytes.size();
}

class TextExport {
 public:
  explicit TextExport(NewFile& to) : to_(to) {}

  Result<void> begin(const std::string& header_line) {
    out_ = fmt::format("{}\n{}", kFirstLine, kGuide);
    if (!header_line.empty()) out_ += "header " + json_for_terminal(header_line) + '\n';
    return flush();
  }

  Result<void> add(const Record& record) {
    if (record.event != nullptr) {
      time(record.at);
      event(record);
    } else {
      block(record);
    }
    return flush();
  }

 private:
  void time(TapeTime at) {
    const std::int64_t second = to_us(at) / 1'000'000;
    if (second != second_) out_ += fmt::format("# {} s\n", second);
    second_ = second;
    out_ += '+' + seconds_of_us(to_us(at) - to_us(last_)) + ' ';
    last_ = at;
  }

  void event(const Record& record) {
    const std::string line(record.event_line);
    std::string bare = line;
    // All but its time: that stands in front.
    if (line.starts_with(kTimeKey) && !std::holds_alternative<event::Gap>(*record.event)) {
      const std::size_t comma = line.find_first_not_of("0123456789", kTimeKey.size());
      if (comma < line.size() && line[comma] == ',') bare = "{" + line.substr(comma + 1);
    }
    if (std::holds_alternative<event::End>(*record.event)) {
      out_ += "end\n";
    } else if (bare == R"({"event":"open"})" || bare == R"({"event":"close"})") {
      out_ += std::holds_alternative<event::Open>(*record.event) ? "open\n" : "close\n";
    } else {
      out_ += "event " + json_for_terminal(bare) + '\n';
    }
  }

  void block(const Record& record) {
    if (record.piece_offset == 0) {
      time(record.at);
      out_ += record.kind == RecordKind::read ? 'r' : 'w';
      if (record.block_length == 0) out_ += '\n';
    }
    if (record.block_length == 0) return;
    bool first = record.piece_offset == 0;
    for (ByteView left = record.data; !left.empty(); first = false) {
      const bool plain = is_plain(left.first(std::min(left.size(), kCharsOfLine)));
      const std::size_t size = plain ? line_of(left) : std::min(left.size(), kHexOfLine);
      out_ += first ? " " : "  ";
      plain ? text(left.first(size)) : hex(left.first(size));
      out_ += '\n';
      left = left.subspan(size);
    }
  }

  // To the end of the line that the device sees.
  static std::size_t line_of(ByteView bytes) {
    const ByteView most = bytes.first(std::min(bytes.size(), kCharsOfLine));
    const auto newline = std::ranges::find(most, Byte{'\n'});
    return newline == most.end() ? most.size() : static_cast<std::size_t>(newline - most.begin()) + 1;
  }
  void text(ByteView bytes) {
    out_ += '"';
    out_ += to_printable(bytes);
    out_ += '"';
  }
  void hex(ByteView bytes) {
    std::string shown;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      out_ += fmt::format("{}{:02x}", i == 0 ? "" : " ", bytes[i]);
      shown += bytes[i] >= 0x20 && bytes[i] < 0x7f ? static_cast<char>(bytes[i]) : '.';
    }
    out_ += "  # " + shown;
  }
  Result<void> flush() {
    const Result<void> added = to_.add(out_);
    out_.clear();
    return added;
  }

  NewFile& to_;
  std::string out_;
  TapeTime last_{};
  std::int64_t second_ = 0;
};

}  // namespace

Result<std::optional<TapeTime>> import_text(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return TextImport(from, to).run(progress);
}

Result<std::vector<std::string>> export_text(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  TextExport text(to);
  if (Result<void> begun = text.begin(from.header_line()); !begun) return begun.error();
  const Result<void> all =
      each_record(from, progress, [&](const Record& record) { return text.add(record); });
  if (!all) return all.error();
  return std::vector<std::string>{};
}

int detect_text(std::string_view head) { return head.starts_with(kFirstLine) ? 100 : 0; }

}  // namespace porttape
