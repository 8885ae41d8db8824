#include "tools/cat_lines.hpp"

#include <algorithm>
#include <iomanip>
#include <string>
#include <string_view>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

constexpr std::string_view kPlain = "\x1b[0m";
constexpr std::string_view kGreen = "\x1b[32m";
constexpr std::string_view kCyan = "\x1b[36m";
constexpr std::string_view kYellow = "\x1b[33m";

std::ostream& print_time(std::ostream& out, TapeTime at) {
  return out << std::right << std::setw(13) << seconds_number(to_us(at)) << "  ";
}

// What a line of the events file says besides time and kind: `"text":"here"`; the whole line where it is not
// of the usual form.
std::string_view details(const Record& record) {
  const std::string usual =
      "{\"t_us\":" + std::to_string(to_us(record.at)) + ",\"event\":" + json_quote(name_of(*record.event));
  std::string_view line = record.event_line;
  if (!line.starts_with(usual) || !line.ends_with('}')) return line;
  line = line.substr(usual.size(), line.size() - usual.size() - 1);
  return line.starts_with(',') ? line.substr(1) : line;
}

}  // namespace

void TextCatPrinter::begin(const CatLine& line) {
  line_ = line;
  shown_.clear();
}

void TextCatPrinter::data(ByteView piece) {
  const std::size_t take = std::min(kShown - shown_.size(), piece.size());
  shown_.insert(shown_.end(), piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(take));
}

void TextCatPrinter::end() {
  const bool is_read = line_.direction == Direction::read;
  const std::string_view more = line_.length > shown_.size() ? "..." : "";
  print_time(out_, line_.at);
  if (color_) out_ << (is_read ? kGreen : kCyan);
  out_ << (is_read ? 'r' : 'w') << ' ' << std::setw(6) << line_.length << "  \"" << to_printable(shown_)
       << '"' << more << "  " << to_hex(shown_) << more;
  if (color_) out_ << kPlain;
  out_ << '\n';
}

void TextCatPrinter::event(const Record& record) {
  print_time(out_, record.at);
  if (color_) out_ << kYellow;
  const std::string more = printable_line(details(record));
  out_ << "-  " << printable_line(name_of(*record.event)) << (more.empty() ? "" : "  ") << more;
  if (color_) out_ << kPlain;
  out_ << '\n';
}

void JsonCatPrinter::begin(const CatLine& line) {
  out_ << "{\"t_us\":" << to_us(line.at) << ",\"until_us\":" << to_us(line.until) << ",\"dir\":\""
       << (line.direction == Direction::read ? 'r' : 'w') << "\",\"offset\":" << line.stream_offset
       << ",\"length\":" << line.length << ",\"blocks\":" << line.blocks << ",\"hex\":\"";
}

void JsonCatPrinter::data(ByteView piece) { out_ << to_hex(piece); }

void JsonCatPrinter::end() { out_ << "\"}\n"; }

// The line of the tape is a JSON object already.
void JsonCatPrinter::event(const Record& record) { out_ << json_for_terminal(record.event_line) << '\n'; }

}  // namespace porttape
