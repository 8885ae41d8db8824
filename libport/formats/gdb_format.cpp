#include "libport/formats/gdb_format.hpp"

#include <algorithm>
#include <array>

#include "libport/base/whole_number.hpp"
#include "libport/formats/byte_text.hpp"
#include "libport/formats/line_import.hpp"

namespace porttape {
namespace {

constexpr std::string_view kBreakRemark = "<Break>";

// What gdb says of a wait that brought no byte stands among the bytes: its length, 0 where it is none.
std::size_t remark_size(std::string_view text) {
  constexpr std::array<std::string_view, 4> kRemarks{"<Timeout: ", "<Error: ", "<Eof>", kBreakRemark};
  for (const std::string_view remark : kRemarks) {
    if (text.starts_with(remark)) return remark.ends_with('>') ? remark.size() : text.find('>') + 1;
  }
  return 0;
}

struct GdbLine {
  Bytes bytes;
  bool breaks = false;  // one was received or sent
};

// In the bases hex and octal each number has a space before it, with which ascii does not begin behind "w ".
std::optional<GdbLine> gdb_line(std::string_view text) {
  constexpr std::size_t kOctalDigits = 3;
  GdbLine line;
  std::string plain;
  const bool numbers = text.starts_with(' ');
  while (!text.empty()) {
    const std::size_t space = numbers && text.front() == ' ' ? 1 : 0;
    text.remove_prefix(space);
    if (const std::size_t remark = remark_size(text); remark > 0) {
      line.breaks |= text.starts_with(kBreakRemark);
      text.remove_prefix(remark);
      continue;
    }
    if (!numbers) {
      const std::size_t size = text.front() == '\\' && text.size() > 1 ? 2 : 1;
      plain += text.substr(0, size);
      text.remove_prefix(size);
      continue;
    }
    const std::string_view number = text.substr(0, text.find_first_of(" <"));
    const auto value = whole_number<unsigned>(number, number.size() == kOctalDigits ? 8 : 16);
    if (!value || *value > 0xff || number.size() < 2) return std::nullopt;
    line.bytes.push_back(static_cast<Byte>(*value));
    text.remove_prefix(number.size());
  }
  if (numbers) return line;
  std::size_t wrong_at = 0;
  const auto bytes = unescaped_bytes(plain, wrong_at);
  if (!bytes) return std::nullopt;
  line.bytes = *bytes;
  return line;
}

class GdbImport final : public LineImport {
 public:
  GdbImport(Evidence& from, ImportTape& to) : LineImport(from, to) { to.keep_order(); }

 private:
  Result<void> take_line() override {
    const std::string_view text = line().text;
    // A command of the user's, and gdb's own last word.
    if (text.empty() || text.starts_with("c ") || text == "End of log") return {};
    if (text.size() < 2 || (text[0] != 'w' && text[0] != 'r') || text[1] != ' ') {
      tape().problem_of_line(line().number, "not gdb's; left out");
      return {};
    }
    const auto said = gdb_line(text.substr(2));
    if (!said) {
      tape().problem_of_line(line().number, "bytes are damaged; left out");
      return {};
    }
    const bool written = text[0] == 'w';
    if (said->breaks) {
      const Side by = written ? Side::driver : Side::device;
      for (const bool on : {true, false}) {
        if (Result<void> told = tape().event(tape().latest(), event::Break{on, by}); !told) return told;
      }
    }
    if (said->bytes.empty()) return {};
    return placed(tape().block(written ? Direction::write : Direction::read, std::nullopt, said->bytes));
  }

  Result<void> at_end() override {
    tape().guessed(
        tape().options().bytes_at
            ? "times are by the line's speed, since gdb's log has none"
            : "all bytes came at once, since gdb's log has no times; --bytes-at BAUD spreads them");
    end_at(tape().latest());
    return {};
  }
};

}  // namespace

Result<std::optional<TapeTime>> import_gdb(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return GdbImport(from, to).run(progress);
}

// Packets begin with $, and are acknowledged by +.
int detect_gdb(std::string_view head) {
  constexpr int kLinesLookedAt = 20;
  for (int lines = 0; lines < kLinesLookedAt && !head.empty(); ++lines) {
    const std::size_t end = head.find('\n');
    const std::string_view line = head.substr(0, end);
    for (const std::string_view begin : {"w $", "w +$", "w  24", "w  2b 24", "w  044", "w  053 044"}) {
      if (line.starts_with(begin)) return 80;
    }
    if (end == std::string_view::npos) break;
    head.remove_prefix(end + 1);
  }
  return 0;
}

}  // namespace porttape
