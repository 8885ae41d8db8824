#include "tools/cat_lines.hpp"

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/utf8.hpp"
#include "tools/output.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

constexpr std::string_view kMore = "...";
// Quotes around the text, two blanks before the hex, and both said to be cut.
constexpr std::size_t kFrame = 4;
constexpr std::size_t kCut = 6;
constexpr std::size_t kUsualWidth = 80;
// Bytes of the first characters of a text that fit into so many columns.
std::size_t fitting(std::string_view text, std::size_t columns) {
  std::size_t size = 0;
  for (; columns > 0 && size < text.size(); --columns)
    size += std::max<std::size_t>(utf8_length(text.substr(size)), 1);
  return size;
}

}  // namespace

std::string event_details(const Event& event, TapeTime at, std::string_view line) {
  if (const auto* settings = std::get_if<event::Settings>(&event)) return settings_text(*settings);
  if (const auto signal = signal_of(event)) return signal_text(*signal);
  const std::string usual =
      "{\"t_us\":" + std::to_string(to_us(at)) + ",\"event\":" + json_quote(name_of(event));
  if (!line.starts_with(usual) || !line.ends_with('}')) return std::string(line);
  line = line.substr(usual.size(), line.size() - usual.size() - 1);
  return std::string(line.starts_with(',') ? line.substr(1) : line);
}

std::string TextCatPrinter::head_text(TapeTime at) {
  constexpr std::size_t usual = 13;
  const Micros since = at - std::exchange(before_, at);
  std::string text;
  switch (layout_.times) {
    case Times::tape:
      text = seconds_number(to_us(at));
      break;
    case Times::delta:
      text = "+" + seconds_number(since.count());
      break;
    case Times::wall:
      text = later(layout_.zero, at - TapeTime{}).wall.for_line();
      break;
  }
  text.insert(0, text.size() < usual ? usual - text.size() : 0, ' ');
  text += "  ";
  if (!tape().empty()) {
    const std::string name = printable_line(tape());
    text += name + std::string(layout_.tape_columns - std::min(layout_.tape_columns, name.size()) + 2, ' ');
  }
  plain_columns_ = text.size();
  return text;
}

std::size_t TextCatPrinter::columns_of(Byte byte) const {
  const std::size_t hex = layout_.form == Form::text ? 0 : 2;
  return hex + (layout_.form == Form::hex ? 0 : to_printable(ByteView(&byte, 1)).size());
}

std::string TextCatPrinter::row_text(std::string_view more) const {
  std::string text;
  if (layout_.form != Form::hex) text = '"' + to_printable(row_) + '"' + std::string(more);
  if (layout_.form == Form::both) text += "  ";
  if (layout_.form != Form::text) text += to_hex(row_) + std::string(more);
  return text;
}

std::size_t TextCatPrinter::room() const {
  const std::size_t width = layout_.width.value_or(kUsualWidth);
  return width > head_.size() + kFrame ? width - head_.size() - kFrame : 0;
}

void TextCatPrinter::begin(const CatLine& line) {
  line_ = line;
  const std::string length = std::to_string(line.length);
  head_ = head_text(line.at) + (line.direction == Direction::read ? 'r' : 'w') + ' ' +
          std::string(length.size() < 6 ? 6 - length.size() : 0, ' ') + length + "  ";
  row_.clear();
  columns_ = 0;
  full_row_ = false;
}

void TextCatPrinter::data(ByteView piece) {
  for (const Byte byte : piece) {
    if (full_row_) return;
    add(byte);
  }
}

// At least one byte goes into a row, however narrow it is.
void TextCatPrinter::add(Byte byte) {
  const std::size_t wanted = columns_of(byte);
  if (layout_.full) {
    if (!row_.empty() && columns_ + wanted > room()) print_row({});
  } else {
    full_row_ = !row_.empty() && (layout_.width ? columns_ + wanted > room() : row_.size() == kShown);
    if (full_row_) return;
  }
  row_.push_back(byte);
  columns_ += wanted;
}

void TextCatPrinter::print_row(std::string_view more) {
  const Color color = line_.direction == Direction::read ? Color::read : Color::write;
  out_ << std::string_view(head_).substr(0, plain_columns_) << color_begin(color, layout_.color)
       << std::string_view(head_).substr(plain_columns_) << row_text(more) << color_end(layout_.color)
       << '\n';
  head_.assign(head_.size(), ' ');
  row_.clear();
  columns_ = 0;
}

void TextCatPrinter::end() {
  const bool whole = layout_.full || row_.size() == line_.length;
  // There must be room to say that it is cut.
  while (!whole && layout_.width && row_.size() > 1 && columns_ + kCut > room()) {
    columns_ -= columns_of(row_.back());
    row_.pop_back();
  }
  print_row(whole ? std::string_view() : kMore);
}

void TextCatPrinter::event(const Record& record, TapeTime at) {
  const std::string more = printable_line(event_details(*record.event, record.at, record.event_line));
  std::string text = "-  " + printable_line(name_of(*record.event)) + (more.empty() ? "" : "  ") + more;
  head_ = head_text(at);
  const std::size_t columns = layout_.full || layout_.width ? room() + kFrame : text.size();
  std::string_view left = text;
  do {
    std::size_t size = fitting(left, columns);
    const bool cut = size < left.size() && !layout_.full;
    if (cut) size = fitting(left, columns - std::min(columns, kMore.size()));
    if (size == 0) size = left.size();  // narrower than its time
    out_ << head_ << color_begin(Color::event, layout_.color) << left.substr(0, size) << (cut ? kMore : "")
         << color_end(layout_.color) << '\n';
    left = cut ? std::string_view() : left.substr(size);
    head_.assign(head_.size(), ' ');
  } while (!left.empty());
}

void JsonCatPrinter::begin(const CatLine& line) {
  out_ << '{' << of_tape() << "\"t_us\":" << to_us(line.at) << ",\"until_us\":" << to_us(line.until)
       << ",\"dir\":\"" << (line.direction == Direction::read ? 'r' : 'w')
       << "\",\"offset\":" << line.stream_offset << ",\"length\":" << line.length
       << ",\"blocks\":" << line.blocks << ",\"hex\":\"";
}

void JsonCatPrinter::data(ByteView piece) { out_ << to_hex(piece); }

void JsonCatPrinter::end() { out_ << "\"}\n"; }

std::string JsonCatPrinter::of_tape() const {
  return tape().empty() ? std::string() : "\"tape\":" + json_quote(tape()) + ',';
}

// The line of the tape is a JSON object already.
void JsonCatPrinter::event(const Record& record, TapeTime at) {
  std::string line = at == record.at ? std::string(record.event_line) : encode_again(record.event_line, at);
  if (line.ends_with('\n')) line.pop_back();
  if (const std::size_t begin = line.find('{'); begin != std::string::npos) line.insert(begin + 1, of_tape());
  out_ << json_for_terminal(line) << '\n';
}

}  // namespace porttape
