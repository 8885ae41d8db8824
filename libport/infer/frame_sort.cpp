#include "libport/infer/frame_sort.hpp"

#include <algorithm>

#include "libport/rules/framing.hpp"

namespace porttape {

std::vector<Frame> cut_frames(const SessionTape& session, std::span<const FrameSort> sorts) {
  std::vector<Frame> frames;
  visit_frames(session, sorts, [&](const Frame& frame) {
    frames.push_back(frame);
    return true;
  });
  return frames;
}

void visit_frames(const SessionTape& session, std::span<const FrameSort> sorts,
                  const std::function<bool(const Frame&)>& take) {
  std::size_t at = 0;
  for (const SessionTape::Block& block : session.blocks) {
    if (block.direction != Direction::write) continue;
    const std::size_t end = block.begin + block.size;
    while (at < end) {
      const ByteView rest = ByteView(session.writes).subspan(at);
      std::size_t taken = 0;
      for (std::size_t sort = 0; sort < sorts.size() && taken == 0; ++sort) {
        const FrameFormat& format = sorts[sort].format;
        const bool by_pause = format.kind == FrameFormat::Kind::idle;
        const FrameCut cut = cut_frame(format, by_pause ? rest.first(end - at) : rest, true);
        if (cut.state != FrameCut::State::frame) continue;
        taken = cut.size;
        if (!take({sort, at, rest.first(taken)})) return;
      }
      at += std::max<std::size_t>(taken, 1);
    }
  }
}

}  // namespace porttape
