#include "libport/formats/socat_raw_format.hpp"

#include <algorithm>
#include <filesystem>

namespace porttape {
namespace {

// The file of what the driver read, beside that of what it wrote.
std::optional<std::string> file_of_reads(const Evidence& from, const ImportTape& to) {
  if (to.options().with) return to.options().with;
  std::string name = from.name();
  const std::size_t at = name.rfind('r');
  if (at == std::string::npos || name.find('/', at) != std::string::npos) return std::nullopt;
  name[at] = 'R';
  std::error_code none;
  return std::filesystem::is_regular_file(name, none) ? std::optional(name) : std::nullopt;
}

// A line, or what is left, or so much of it.
Result<Bytes> next_line(Evidence& from) {
  constexpr std::size_t kMostOfLine = 4096;
  const auto head = from.peek(kMostOfLine);
  if (!head) return head.error();
  const auto newline = std::ranges::find(*head, Byte{'\n'});
  Bytes line(head->begin(), newline == head->end() ? newline : newline + 1);
  if (const auto skipped = from.skip(line.size()); !skipped) return skipped.error();
  return line;
}

}  // namespace

Result<std::optional<TapeTime>> import_socat_raw(Evidence& from, ImportTape& to,
                                                 const ConvertProgress& progress) {
  const std::optional<std::string> other = file_of_reads(from, to);
  Result<Evidence> reads = other ? Evidence::open(*other) : Evidence::of("", "");
  if (!reads) return reads.error();
  if (!other) to.guessed("nothing was read: --with FILE names the file of socat -R");
  to.guessed("what was written and what was read took turns by lines, since socat -r and -R keep no order");
  to.guessed(
      to.options().bytes_at
          ? "times are by the line's speed, since socat -r and -R keep none"
          : "all bytes came at once, since socat -r and -R keep no times; --bytes-at BAUD spreads them");
  for (;;) {
    const auto written = next_line(from);
    if (!written) return written.error();
    const auto read = next_line(*reads);
    if (!read) return read.error();
    if (written->empty() && read->empty()) break;
    if (!written->empty()) {
      if (Result<void> put = to.block(Direction::write, std::nullopt, *written); !put) return put.error();
    }
    if (!read->empty()) {
      if (Result<void> put = to.block(Direction::read, std::nullopt, *read); !put) return put.error();
    }
    if (progress) progress(from.offset());
  }
  return std::optional(to.latest());
}

}  // namespace porttape
