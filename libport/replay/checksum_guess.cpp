#include "libport/replay/checksum_guess.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

#include "libport/base/checksum.hpp"

namespace porttape {
namespace {

// One of the catalogue's, as it stands in frames.
struct SumKind {
  std::string_view name;  // for a person
  std::string_view kind;
  unsigned bits;     // that chance would have to hit
  bool hex = false;  // as two digits a byte
  bool inverted = false;
  bool low_first = false;
};

constexpr std::array kSumKinds = {
    SumKind{.name = "CRC-16/MODBUS", .kind = "CRC-16/MODBUS", .bits = 16, .low_first = true},
    SumKind{"CRC-16/XMODEM", "CRC-16/XMODEM", 16},
    SumKind{"CRC-16/CCITT-FALSE", "CRC-16/CCITT-FALSE", 16},
    SumKind{"Fletcher", "FLETCHER-UBX", 16},
    SumKind{"XOR", "XOR", 8, true},
    SumKind{"sum", "SUM-8", 8, true},
    SumKind{"LRC", "LRC", 8, true},
    SumKind{.name = "CRC-16/MODBUS", .kind = "CRC-16/MODBUS", .bits = 16, .hex = true, .low_first = true},
    SumKind{"CRC-16/XMODEM", "CRC-16/XMODEM", 16, true},
    SumKind{"CRC-16/CCITT-FALSE", "CRC-16/CCITT-FALSE", 16, true},
    SumKind{"XOR", "XOR", 8},
    SumKind{"sum", "SUM-8", 8},
    SumKind{"LRC", "LRC", 8},
    SumKind{.name = "inverted sum", .kind = "SUM-8", .bits = 8, .inverted = true},
    SumKind{"SCIP sum", "SCIP", 6},
};
constexpr std::size_t kMostSkipped = 2;  // bytes before those that it is over: a `$`, a preamble
constexpr unsigned kEnoughBits = 24;     // of all frames together
constexpr std::size_t kMostFrames = 64;

ByteView without_line_end(ByteView frame) {
  while (!frame.empty() && is_line_end(frame.back())) frame = frame.first(frame.size() - 1);
  return frame;
}

// Those of kSumKinds, in its order.
const std::array<const ChecksumKind*, kSumKinds.size()>& catalogued() {
  static const auto found = [] {
    std::array<const ChecksumKind*, kSumKinds.size()> all{};
    std::ranges::transform(kSumKinds, all.begin(), find_checksum, &SumKind::kind);
    return all;
  }();
  return found;
}

Bytes sum_over(std::size_t kind, ByteView bytes) {
  const ChecksumKind& catalogue = *catalogued().at(kind);
  const SumKind& own = kSumKinds.at(kind);
  const std::uint32_t value = checksum_of(catalogue, bytes) ^ (own.inverted ? ~0U : 0U);
  Bytes sum;
  for (std::size_t at = catalogue.size(); at > 0; --at)
    sum.push_back(static_cast<Byte>(value >> (8 * (at - 1))));
  if (own.low_first) std::ranges::reverse(sum);
  return sum;
}

Bytes digits(ByteView bytes, bool upper) {
  std::string hex = to_hex(bytes);
  if (upper)
    std::ranges::transform(hex, hex.begin(), [](char c) { return c >= 'a' ? static_cast<char>(c - 32) : c; });
  return {hex.begin(), hex.end()};
}

}  // namespace

std::string_view ChecksumGuess::name() const { return kSumKinds.at(kind_).name; }

std::optional<ChecksumGuess::Field> ChecksumGuess::field(ByteView frame) const {
  const SumKind& kind = kSumKinds.at(kind_);
  const ByteView body = without_line_end(frame);
  const std::size_t size = catalogued().at(kind_)->size() * (kind.hex ? 2 : 1);
  if (body.size() <= begin_ + size + (separated_ ? 1U : 0U)) return std::nullopt;
  Field field;
  field.at = body.size() - size;
  const ByteView has = body.subspan(field.at);
  field.has.assign(has.begin(), has.end());
  ByteView over = body.first(field.at).subspan(begin_);
  if (separated_) over = over.first(over.size() - 1);
  field.right = sum_over(kind_, over);
  if (kind.hex)
    field.right = digits(field.right, std::ranges::none_of(field.has, [](Byte b) { return b >= 'a'; }));
  return field;
}

std::optional<ChecksumGuess> ChecksumGuess::of(const std::vector<ByteView>& frames) {
  std::vector<ByteView> different;
  for (const ByteView frame : frames) {
    const auto same = [frame](ByteView other) { return std::ranges::equal(frame, other); };
    if (different.size() < kMostFrames && std::ranges::none_of(different, same)) different.push_back(frame);
  }
  for (std::size_t kind = 0; kind < kSumKinds.size(); ++kind) {
    if (kSumKinds.at(kind).bits * different.size() < kEnoughBits) continue;
    for (std::size_t variant = 0; variant < 2 * (kMostSkipped + 1); ++variant) {
      const ChecksumGuess guess(kind, variant / 2, variant % 2 == 1);
      const bool right = std::ranges::all_of(different, [&guess](ByteView frame) {
        const std::optional<Field> field = guess.field(frame);
        return field && field->has == field->right;
      });
      if (right) return guess;
    }
  }
  return std::nullopt;
}

}  // namespace porttape
