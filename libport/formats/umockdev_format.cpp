#include "libport/formats/umockdev_format.hpp"

#include <algorithm>
#include <fmt/format.h>

#include "libport/base/whole_number.hpp"
#include "libport/formats/each_record.hpp"
#include "libport/formats/line_import.hpp"

namespace porttape {
namespace {

constexpr std::int64_t kUsOfMs = 1000;
constexpr std::int64_t kLatestMs = 4'294'967'295'000;

// "r 5 OK^M^J"
struct ScriptLine {
  char operation = 0;
  std::int64_t ms = 0;
  std::size_t data_at = 0;
  std::string_view data;
};

std::optional<ScriptLine> script_line(std::string_view text) {
  if (text.size() < 3 || text[1] != ' ') return std::nullopt;
  const std::size_t space = std::min(text.find(' ', 2), text.size());
  const auto ms = whole_number<std::int64_t>(text.substr(2, space - 2));
  if (!ms || *ms < 0 || *ms > kLatestMs) return std::nullopt;
  const std::size_t data_at = std::min(space + 1, text.size());
  return ScriptLine{text[0], *ms, data_at, text.substr(data_at)};
}

// Where it is wrong: nothing, and `wrong_at` says where in the text.
std::optional<Bytes> script_bytes(std::string_view text, std::size_t& wrong_at) {
  Bytes bytes;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '^') {
      bytes.push_back(static_cast<Byte>(text[i]));
      continue;
    }
    wrong_at = i;
    if (++i == text.size() || text[i] < '@' || text[i] > '`') return std::nullopt;
    bytes.push_back(text[i] == '`' ? Byte{'^'} : static_cast<Byte>(text[i] - '@'));
  }
  return bytes;
}

std::string script_text(ByteView bytes) {
  std::string text;
  for (const Byte byte : bytes) {
    if (byte == '^') {
      text += "^`";
    } else if (byte < ' ') {
      text += '^';
      text += static_cast<char>(byte + '@');
    } else {
      text += static_cast<char>(byte);
    }
  }
  return text;
}

class UmockdevImport final : public LineImport {
 public:
  UmockdevImport(Evidence& from, ImportTape& to) : LineImport(from, to) { to.keep_order(); }

 private:
  Result<void> take_line() override {
    const std::string_view text = line().text;
    if (over_ || text.empty() || text.front() == '#') return {};
    over_ = text.front() == 'Q';
    if (over_) return {};
    const auto step = script_line(text);
    if (!step) return wrong(0, "an operation is expected: w or r, milliseconds, and the bytes");
    if (step->operation == 'f' || step->operation == 'd') return {};
    if (step->operation != 'r' && step->operation != 'w')
      return wrong(0, "the operation is unknown; accepted: r, w, f, d, Q");
    std::size_t wrong_at = 0;
    const auto bytes = script_bytes(step->data, wrong_at);
    if (!bytes) return wrong(step->data_at + wrong_at, "a ^ stands before none of @ to `");
    ms_ += step->ms;
    if (ms_ > kLatestMs) return wrong(2, "the time is over 136 years");
    return placed(tape().block(step->operation == 'r' ? Direction::read : Direction::write,
                               tape_time_us(ms_ * kUsOfMs), *bytes));
  }

  Result<void> at_end() override {
    end_at(tape().latest());
    return {};
  }

  std::int64_t ms_ = 0;
  bool over_ = false;  // notes follow
};

}  // namespace

Result<std::optional<TapeTime>> import_umockdev(Evidence& from, ImportTape& to,
                                                const ConvertProgress& progress) {
  return UmockdevImport(from, to).run(progress);
}

Result<std::vector<std::string>> export_umockdev(TapeReader& from, NewFile& to,
                                                 const ConvertProgress& progress) {
  bool events = false;
  bool empty = false;
  std::int64_t last_ms = 0;
  const Result<void> all = each_record(from, progress, [&](const Record& record) -> Result<void> {
    events |= record.event != nullptr;
    empty |= record.event == nullptr && record.block_length == 0;
    if (record.event != nullptr || record.block_length == 0) return {};
    std::string text;
    if (record.piece_offset == 0) {
      const std::int64_t ms = to_us(record.at) / kUsOfMs;
      text = fmt::format("{} {} ", record.kind == RecordKind::read ? 'r' : 'w', ms - last_ms);
      last_ms = ms;
    }
    text += script_text(record.data);
    if (record.last_piece()) text += '\n';
    return to.add(text);
  });
  if (!all) return all.error();
  std::vector<std::string> lost{"times below a millisecond"};
  if (events) lost.emplace_back("events");
  if (empty) lost.emplace_back("empty blocks");
  return lost;
}

int detect_umockdev(std::string_view head) {
  constexpr int kEnough = 5;
  int found = 0;
  while (found < kEnough) {
    const std::size_t end = head.find('\n');
    if (end == std::string_view::npos) break;
    const std::string_view text = head.substr(0, end);
    head.remove_prefix(end + 1);
    if (text.starts_with('#') || text.starts_with("d 0 ") || text.starts_with("f ")) continue;
    const auto step = script_line(text);
    std::size_t wrong_at = 0;
    if (!step || (step->operation != 'r' && step->operation != 'w') || !script_bytes(step->data, wrong_at))
      return 0;
    ++found;
  }
  return found > 0 ? 50 + found : 0;
}

}  // namespace porttape
