#include "libport/formats/gpsd_format.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

#include "libport/base/whole_number.hpp"
#include "libport/formats/each_record.hpp"

namespace porttape {
namespace {

constexpr std::string_view kSerialComment = "# Serial:";
constexpr std::string_view kGpsdHead = "# Name: a tape of a receiver\n# Submitted-by: porttape convert\n";
constexpr std::string_view kParityLetters = "NEOMS";  // as Parity has them

// The settings of "# Serial: 4800 8N1"; nothing: it is another comment.
std::optional<SeenSettings> settings_of_comment(std::string_view line) {
  constexpr std::string_view kSpaces = " \t\r\n";
  if (!line.starts_with(kSerialComment)) return std::nullopt;
  line.remove_prefix(kSerialComment.size());
  line.remove_prefix(std::min(line.find_first_not_of(kSpaces), line.size()));
  const std::string_view rate = line.substr(0, line.find_first_of(kSpaces));
  SeenSettings settings;
  settings.baud = whole_number<unsigned>(rate);
  if (!settings.baud || *settings.baud == 0) return std::nullopt;
  line.remove_prefix(rate.size());
  line.remove_prefix(std::min(line.find_first_not_of(kSpaces), line.size()));
  const std::size_t parity = line.size() < 3 ? std::string_view::npos : kParityLetters.find(line[1]);
  const bool told = parity != std::string_view::npos && line[0] >= '5' && line[0] <= '8' &&
                    (line[2] == '1' || line[2] == '2');
  if (!told) return settings;
  settings.data_bits = static_cast<unsigned>(line[0] - '0');
  settings.parity = static_cast<Parity>(parity);
  settings.stop_bits = static_cast<unsigned>(line[2] - '0');
  return settings;
}

bool is_comment(ByteView bytes) {
  return !bytes.empty() && bytes.front() == '#' &&
         std::ranges::all_of(bytes, [](Byte b) { return b >= ' ' || b == '\n' || b == '\r' || b == '\t'; });
}

class GpsdImport {
 public:
  GpsdImport(Evidence& from, ImportTape& to) : from_(from), to_(to), rate_(to.options().bytes_at) {}

  Result<std::optional<TapeTime>> run(const ConvertProgress& progress) {
    to_.keep_order();
    to_.guessed("all bytes are the receiver's, since a gpsd log has no others");
    for (;;) {
      // A line, or a piece of what is none.
      constexpr std::size_t kMostOfLine = 4096;
      const auto head = from_.peek(kMostOfLine);
      if (!head) return head.error();
      if (head->empty()) break;
      const auto newline = std::ranges::find(*head, Byte{'\n'});
      const bool ends = newline != head->end();
      const Bytes piece(head->begin(), ends ? newline + 1 : newline);
      if (const auto skipped = from_.skip(piece.size()); !skipped) return skipped.error();
      if (at_line_) in_comment_ = is_comment(piece);
      at_line_ = ends;
      Result<void> taken = in_comment_ ? take_comment(as_text(piece)) : take_bytes(piece);
      if (!taken) return taken.error();
      if (progress) progress(from_.offset());
    }
    tell_guesses();
    return std::optional(to_.latest());
  }

 private:
  Result<void> take_comment(std::string_view text) {
    const auto settings = settings_of_comment(text);
    if (!settings) {
      inner_comments_ += sent_ > 0 ? 1U : 0U;
      return {};
    }
    if (!to_.options().bytes_at) rate_ = settings->baud;
    return to_.event(to_.latest(), event::Settings{Side::device, *settings, std::nullopt});
  }

  Result<void> take_bytes(ByteView bytes) {
    constexpr std::int64_t kBitTimesOfByte = 10'000'000;  // µs at 1 bit/s, 8N1
    sent_ += bytes.size();
    if (!rate_) return to_.block(Direction::read, std::nullopt, bytes);
    return to_.block(Direction::read,
                     to_.latest() + Micros(static_cast<std::int64_t>(bytes.size()) * kBitTimesOfByte /
                                           static_cast<std::int64_t>(*rate_)),
                     bytes);
  }

  void tell_guesses() {
    if (to_.options().bytes_at) {
      to_.guessed("times are by the line's speed, since a gpsd log has none");
    } else if (rate_) {
      to_.guessed("times are by the rate that the log tells, since it has none");
    } else {
      to_.guessed("all bytes came at once, since a gpsd log has no times; --bytes-at BAUD spreads them");
    }
    if (inner_comments_ > 0)
      to_.guessed(
          fmt::format("{} lines among the receiver's that begin with # are comments", inner_comments_));
  }

  Evidence& from_;
  ImportTape& to_;
  std::optional<unsigned> rate_;
  bool at_line_ = true;
  bool in_comment_ = false;
  std::uint64_t sent_ = 0;
  std::uint64_t inner_comments_ = 0;
};

// Nothing: the rate is not known.
std::string comment_of(const SeenSettings& settings) {
  if (settings.baud.value_or(0) == 0) return {};
  return fmt::format("{} {} {}{}{}\n", kSerialComment, *settings.baud, settings.data_bits.value_or(8),
                     kParityLetters.at(static_cast<std::size_t>(settings.parity.value_or(Parity::none))),
                     settings.stop_bits.value_or(1));
}

}  // namespace

Result<std::optional<TapeTime>> import_gpsd(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return GpsdImport(from, to).run(progress);
}

Result<std::vector<std::string>> export_gpsd(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  bool written = false;
  bool events = false;
  bool begun = false;
  std::string serial;  // the latest before the first byte
  const Result<void> all = each_record(from, progress, [&](const Record& record) -> Result<void> {
    written |= record.kind == RecordKind::write;
    events |= record.event != nullptr;
    const auto* const settings =
        record.event == nullptr ? nullptr : std::get_if<event::Settings>(record.event);
    if (settings != nullptr && settings->line.baud.value_or(0) > 0) serial = comment_of(settings->line);
    if (record.kind != RecordKind::read) return {};
    if (!std::exchange(begun, true)) {
      if (Result<void> added = to.add(std::string(kGpsdHead) + serial); !added) return added;
    }
    return to.add(record.data);
  });
  if (!all) return all.error();
  if (!begun) {
    if (Result<void> added = to.add(std::string(kGpsdHead) + serial); !added) return added.error();
  }
  std::vector<std::string> lost{"times and blocks"};
  if (written) lost.emplace_back("what the driver wrote");
  if (events) lost.emplace_back("events");
  return lost;
}

int detect_gpsd(std::string_view head) {
  if (!head.starts_with('#')) return 0;
  for (const std::string_view key :
       {"\n# Submitted-by:", "\n# Serial:", "\n# Delay-Cookie:", "\n# Chipset:", "\n# Submitted by"}) {
    if (head.find(key) != std::string_view::npos) return 70;
  }
  return 0;
}

}  // namespace porttape
