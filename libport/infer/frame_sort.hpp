#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/infer/session_tape.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// One sort of frames as it was found: how it stands in a stream of bytes, and what of a frame tells its kind.
struct FrameSort {
  FrameFormat format{};
  bool text = false;
  // The key: bytes of a frame; of a text its first word, behind marks. Where `whole_words` is not empty, a
  // word that begins with none of these letters counts with its first one only.
  std::size_t key_at = 0;
  std::size_t key_size = 0;
  std::string whole_words{};

  friend bool operator==(const FrameSort&, const FrameSort&) = default;
};

struct Frame {
  std::size_t sort = 0;
  std::size_t begin = 0;  // in the session's writes
  ByteView bytes{};
};

// The writes of a session cut into frames, each by the first sort that it fits; bytes that fit none are left
// out. Frames refer to the session.
std::vector<Frame> cut_frames(const SessionTape& session, std::span<const FrameSort> sorts);
// The same, frame by frame, until `take` is false.
void visit_frames(const SessionTape& session, std::span<const FrameSort> sorts,
                  const std::function<bool(const Frame&)>& take);

// The sorts that all of these sessions are made of: a known protocol's, or what ends, lengths and blocks of
// the tapes show. `why` says so for a person.
struct FoundSorts {
  std::vector<FrameSort> sorts;
  std::string why;
};
FoundSorts find_sorts(std::span<const SessionTape> sessions);

}  // namespace porttape
