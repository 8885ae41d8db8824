#include "libport/infer/echo.hpp"

#include <algorithm>
#include <optional>
#include <set>

#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

constexpr std::size_t kFewestAnswers = 2;

// The bytes of the field in a frame.
std::optional<ByteView> part_of(const FoundSort& sort, const FoundField& field, ByteView frame) {
  const ByteView body = sort.body(frame);
  if (field.what == FoundField::What::word) {
    const TextParts parts = cut_text(as_text(body));
    if (field.word >= parts.words.size() || !field.pattern.matches(parts.words[field.word]))
      return std::nullopt;
    return as_bytes(field.pattern.free_part(parts.words[field.word]));
  }
  if (field.what == FoundField::What::middle || body.size() < field.at + field.size) return std::nullopt;
  return body.subspan(field.at, field.size);
}

// The frame that ends with the driver's byte before `end`, if one does.
const Frame* frame_before(std::span<const Frame> frames, std::size_t end) {
  const auto found = std::ranges::find_if(
      frames, [&](const Frame& frame) { return frame.begin + frame.bytes.size() == end; });
  return found == frames.end() ? nullptr : &*found;
}

// The bytes of the device from a block on, up to the driver's next.
ByteView answer_at(const SessionTape& session, std::size_t block) {
  const std::size_t begin = session.blocks[block].begin;
  std::size_t end = begin;
  for (; block < session.blocks.size() && session.blocks[block].direction == Direction::read; ++block)
    end = session.blocks[block].begin + session.blocks[block].size;
  return ByteView(session.reads).subspan(begin, end - begin);
}

}  // namespace

void find_answers(Findings& findings, std::span<const SessionTape> sessions) {
  std::vector<FrameSort> sorts;
  for (const FoundSort& sort : findings.sorts) sorts.push_back(sort.sort);
  for (const SessionTape& session : sessions) {
    const std::vector<Frame> frames = cut_frames(session, sorts);
    std::span<const Frame> left = frames;
    for (std::size_t block = 1; block < session.blocks.size(); ++block) {
      const SessionTape::Block& before = session.blocks[block - 1];
      if (before.direction != Direction::write || session.blocks[block].direction != Direction::read)
        continue;
      const Frame* request = frame_before(left, before.begin + before.size);
      if (request == nullptr) continue;
      left = left.subspan(static_cast<std::size_t>(request - left.data()));
      const ByteView answer = answer_at(session, block);
      const FrameCut cut = cut_frame(sorts[request->sort].format, answer, true);
      if (cut.state == FrameCut::State::frame)
        findings.answers.emplace(request->bytes.data(), answer.first(cut.size));
    }
  }
}

bool is_echoed(const Findings& findings, std::size_t sort, std::span<const FrameRun> runs,
               const FoundField& field) {
  std::set<Bytes> values;
  std::size_t count = 0;
  for (const FrameRun& run : runs) {
    for (const ByteView frame : run) {
      const auto answer = findings.answers.find(frame.data());
      if (answer == findings.answers.end()) continue;
      const auto asked = part_of(findings.sorts[sort], field, frame);
      const auto answered = part_of(findings.sorts[sort], field, answer->second);
      if (!asked || !answered || !std::ranges::equal(*asked, *answered)) return false;
      values.emplace(asked->begin(), asked->end());
      ++count;
    }
  }
  return count >= kFewestAnswers && values.size() >= 2;
}

}  // namespace porttape
