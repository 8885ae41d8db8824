#include "libport/infer/checksum_search.hpp"

#include <algorithm>
#include <functional>
#include <set>
#include <vector>

#include "libport/rules/checksum.hpp"

namespace porttape {
namespace {

constexpr std::int64_t kMostFrom = 8;
constexpr std::int64_t kMostSkipped = 2;
constexpr std::int64_t kMostTrailing = 4;
constexpr double kDoubtBits = 32;  // some 2^16 places and kinds are tried

std::vector<ChecksumField> places_of(const ChecksumKind& kind) {
  std::vector<ChecksumField> all;
  for (std::int64_t from = 0; from <= kMostFrom; ++from) {
    for (std::int64_t skipped = 0; skipped <= kMostSkipped; ++skipped) {
      for (std::int64_t trailing = 0; trailing <= kMostTrailing; ++trailing) {
        for (const bool hex : {false, true}) {
          ChecksumField field{.kind = std::string(kind.name), .from = from, .hex = hex};
          field.at = -trailing - static_cast<std::int64_t>(size_of(field, kind));
          if (skipped > 0) field.to = field.at - skipped;
          all.push_back(field);
          field.order = ByteOrder::little;
          if (kind.size() > 1 && !hex) all.push_back(field);
        }
      }
    }
  }
  return all;
}

// A sum of nothing is none.
bool holds(const FrameChecksum& checksum, ByteView frame) {
  const auto place = checksum.place(frame);
  return place && place->covers_to > place->covers_from && checksum.holds(frame);
}

// How unlikely it is that all frames hold by chance, in bits; 0 where one does not.
double evidence(const FrameChecksum& checksum, std::size_t sum_size, std::span<const ByteView> frames) {
  std::set<Bytes> different;
  std::set<Bytes> sums;
  for (const ByteView frame : frames) {
    if (!holds(checksum, frame)) return 0;
    const auto place = *checksum.place(frame);
    different.emplace(frame.begin() + static_cast<std::ptrdiff_t>(place.covers_from),
                      frame.begin() + static_cast<std::ptrdiff_t>(place.covers_to));
    sums.emplace(frame.begin() + static_cast<std::ptrdiff_t>(place.begin),
                 frame.begin() + static_cast<std::ptrdiff_t>(place.end));
  }
  if (sums.size() < 2) return 0;
  return static_cast<double>(std::min(different.size(), sums.size() * 4) * sum_size * 8);
}

}  // namespace

std::optional<ChecksumField> find_checksum_field(std::span<const ByteView> frames) {
  if (frames.empty()) return std::nullopt;
  // The widest first: one may be a part of another (of Fletcher's the plain sum).
  std::vector<const ChecksumKind*> kinds;
  for (const ChecksumKind& kind : checksum_kinds()) kinds.push_back(&kind);
  std::ranges::stable_sort(kinds, std::greater(), [](const ChecksumKind* kind) { return kind->size(); });
  for (const ChecksumKind* kind : kinds) {
    for (const ChecksumField& field : places_of(*kind)) {
      const FrameChecksum checksum(field, *kind);
      // Most places are refuted by the first frame.
      if (!holds(checksum, frames.front()) || !holds(checksum, frames.back())) continue;
      if (evidence(checksum, kind->size(), frames) >= kDoubtBits) return field;
    }
  }
  return std::nullopt;
}

bool checksum_holds(const ChecksumField& field, std::span<const ByteView> frames, double share) {
  const ChecksumKind* kind = find_checksum(field.kind);
  if (kind == nullptr || frames.empty()) return false;
  const FrameChecksum checksum(field, *kind);
  const auto right = std::ranges::count_if(frames, [&](ByteView frame) { return checksum.holds(frame); });
  return static_cast<double>(right) >= share * static_cast<double>(frames.size());
}

}  // namespace porttape
