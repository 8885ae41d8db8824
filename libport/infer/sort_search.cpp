// Which sorts of frames the writes of some sessions are made of.

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <set>

#include "libport/infer/checksum_search.hpp"
#include "libport/infer/counters.hpp"
#include "libport/infer/frame_sort.hpp"
#include "libport/infer/known_sorts.hpp"

namespace porttape {
namespace {

using Kind = FrameFormat::Kind;

constexpr double kMostOf = 0.95;  // of the bytes are in frames, of the blocks end with one

// How well sorts go with the sessions.
struct Fit {
  std::size_t frames = 0;
  std::set<std::size_t> used;   // sorts
  std::set<std::size_t> sizes;  // of frames
  double framed = 0;            // of the bytes
  double a_block = 0;           // frames
  double ends = 0;              // of the blocks end where a frame does
  double printable = 0;         // of the framed bytes
  [[nodiscard]] bool good() const { return frames > 0 && framed >= kMostOf && ends >= kMostOf; }
};

bool is_text(Byte byte) {
  return (byte >= 0x20 && byte < 0x7f) || byte == '\r' || byte == '\n' || byte == '\t';
}

double share_of(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

std::vector<const SessionTape::Block*> write_blocks(const SessionTape& session) {
  std::vector<const SessionTape::Block*> blocks;
  for (const SessionTape::Block& block : session.blocks)
    if (block.direction == Direction::write) blocks.push_back(&block);
  return blocks;
}

// Where sorts do not go with the sessions that is known early: it is not counted any further.
Fit fit(std::span<const SessionTape> sessions, std::span<const FrameSort> sorts) {
  std::size_t bytes = 0, blocks = 0;
  std::vector<std::vector<const SessionTape::Block*>> written;
  for (const SessionTape& session : sessions) {
    bytes += session.writes.size();
    blocks += written.emplace_back(write_blocks(session)).size();
  }
  const auto most_outside = static_cast<std::size_t>((1 - kMostOf) * static_cast<double>(bytes)) + 1;
  const auto most_without_end = static_cast<std::size_t>((1 - kMostOf) * static_cast<double>(blocks)) + 1;
  Fit fit;
  std::size_t framed = 0, text = 0, ending = 0, outside = 0, passed = 0;
  for (std::size_t of = 0; of < sessions.size(); ++of) {
    auto block = written[of].begin();
    std::size_t end = 0;  // of the last frame
    visit_frames(sessions[of], sorts, [&](const Frame& frame) {
      ++fit.frames;
      fit.used.insert(frame.sort);
      fit.sizes.insert(frame.bytes.size());
      framed += frame.bytes.size();
      text += static_cast<std::size_t>(std::ranges::count_if(frame.bytes, is_text));
      outside += frame.begin - end;
      end = frame.begin + frame.bytes.size();
      for (; block != written[of].end() && (*block)->begin + (*block)->size <= end; ++block, ++passed)
        ending += std::size_t{(*block)->begin + (*block)->size == end};
      return outside <= most_outside && passed - ending <= most_without_end;
    });
    outside += sessions[of].writes.size() - std::min(sessions[of].writes.size(), end);
    passed += static_cast<std::size_t>(written[of].end() - block);
    if (outside > most_outside || passed - ending > most_without_end) return {};
  }
  fit.framed = share_of(framed, bytes);
  fit.a_block = share_of(fit.frames, blocks);
  fit.ends = share_of(ending, blocks);
  fit.printable = share_of(text, framed);
  return fit;
}

FrameSort line_sort(std::string_view end) {
  FrameSort sort{.text = true};
  sort.format.name = "line";
  sort.format.end = Bytes(end.begin(), end.end());
  return sort;
}

// Whether nearly all frames of the sort have its protocol's checksum right.
bool checks(std::span<const SessionTape> sessions, std::span<const FrameSort> sorts, std::size_t sort) {
  if (!sorts[sort].format.checksum) return true;
  std::vector<ByteView> frames;
  for (const SessionTape& session : sessions)
    for (const Frame& frame : cut_frames(session, sorts))
      if (frame.sort == sort) frames.push_back(frame.bytes);
  return checksum_holds(*sorts[sort].format.checksum, frames, kMostOf);
}

std::optional<FoundSorts> find_known(std::span<const SessionTape> sessions) {
  for (const KnownRow& known : known_rows()) {
    const Fit found = fit(sessions, known.sorts);
    const auto right = [&](std::size_t sort) { return checks(sessions, known.sorts, sort); };
    if (!found.good() || !std::ranges::all_of(found.used, right)) continue;
    FoundSorts result;
    for (const std::size_t sort : found.used) result.sorts.push_back(known.sorts[sort]);
    result.why = fmt::format("{} frames as {} has them", found.frames, known.name);
    return result;
  }
  return std::nullopt;
}

std::optional<FoundSorts> find_lines(std::span<const SessionTape> sessions) {
  constexpr std::array<std::string_view, 6> kMarks = {"\r\n", "\n", "\r", "\x03", ";", {"\0", 1}};
  for (const std::string_view mark : kMarks) {
    const FrameSort sort = line_sort(mark);
    const Fit found = fit(sessions, std::span(&sort, 1));
    if (!found.good() || found.printable < kMostOf) continue;
    return FoundSorts{
        {sort}, fmt::format("{} lines that end with \"{}\"", found.frames, to_printable(as_bytes(mark)))};
  }
  return std::nullopt;
}

// The bytes that all blocks begin with, at most `most`.
Bytes common_begin(std::span<const SessionTape> sessions, std::size_t most) {
  std::optional<Bytes> common;
  for (const SessionTape& session : sessions) {
    for (const SessionTape::Block* block : write_blocks(session)) {
      const ByteView bytes = session.bytes_of(*block).first(std::min(block->size, most));
      if (!common) common = Bytes(bytes.begin(), bytes.end());
      const auto differing = std::mismatch(common->begin(), common->end(), bytes.begin(), bytes.end()).first;
      common->erase(differing, common->end());
    }
  }
  return common.value_or(Bytes{});
}

// Between two blocks that the driver wrote; at most 20 ms.
Micros shortest_pause(std::span<const SessionTape> sessions) {
  Micros shortest{20'000};
  for (const SessionTape& session : sessions) {
    const auto blocks = write_blocks(session);
    for (std::size_t i = 1; i < blocks.size(); ++i)
      shortest = std::min(shortest, Micros{blocks[i]->at - blocks[i - 1]->at});
  }
  return std::max(shortest, Micros{2});
}

std::optional<FoundSorts> find_length(std::span<const SessionTape> sessions) {
  constexpr std::size_t kMostAt = 8;
  constexpr std::int64_t kMostAdd = 16;
  constexpr std::size_t kFewestFrames = 6;
  constexpr double kMostABlock = 1.5;
  for (const LengthField& field :
       {LengthField{0, 2, ByteOrder::big, 0, {}}, LengthField{0, 2, ByteOrder::little, 0, {}},
        LengthField{0, 1, ByteOrder::big, 0, {}}}) {
    for (std::size_t at = 0; at <= kMostAt; ++at) {
      FrameSort sort;
      sort.format.name = "frame";
      sort.format.kind = Kind::length;
      sort.format.start = common_begin(sessions, at);
      sort.format.length = field;
      sort.format.length.at = static_cast<std::int64_t>(at);
      for (std::int64_t adds = 0; adds <= kMostAdd; ++adds) {
        sort.format.length.adds = adds;
        const Fit found = fit(sessions, std::span(&sort, 1));
        if (!found.good() || found.framed < 1 || found.sizes.size() < 2 || found.frames < kFewestFrames ||
            found.a_block > kMostABlock)
          continue;
        return FoundSorts{
            {sort},
            fmt::format("{} frames of {} lengths, as the {}-byte number at byte {} of each says, plus {}",
                        found.frames, found.sizes.size(), field.size, at, adds)};
      }
    }
  }
  return std::nullopt;
}

FrameSort block_sort(std::span<const SessionTape> sessions) {
  FrameSort sort;
  sort.format.name = "frame";
  sort.format.kind = Kind::idle;
  sort.format.idle = shortest_pause(sessions) / 2;
  return sort;
}

std::optional<FoundSorts> find_fixed(std::span<const SessionTape> sessions) {
  constexpr std::size_t kFewestFrames = 6;
  FrameSort sort = block_sort(sessions);
  const Fit found = fit(sessions, std::span(&sort, 1));
  if (found.sizes.size() != 1 || found.frames < kFewestFrames) return std::nullopt;
  sort.format.kind = Kind::fixed;
  sort.format.size = *found.sizes.begin();
  sort.format.idle = {};
  return FoundSorts{{sort}, fmt::format("all of {} blocks have {} bytes", found.frames, sort.format.size)};
}

FoundSorts by_blocks(std::span<const SessionTape> sessions) {
  std::size_t blocks = 0;
  for (const SessionTape& session : sessions) blocks += write_blocks(session).size();
  return {{block_sort(sessions)},
          fmt::format("no end and no length was found: each of the {} blocks is taken for a frame", blocks)};
}

}  // namespace

FoundSorts find_sorts(std::span<const SessionTape> sessions) {
  if (auto found = find_known(sessions)) return *std::move(found);
  if (auto found = find_lines(sessions)) return *std::move(found);
  if (auto found = find_length(sessions)) return *std::move(found);
  if (auto found = find_fixed(sessions)) return *std::move(found);
  return by_blocks(sessions);
}

}  // namespace porttape
