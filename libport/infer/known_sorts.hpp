#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "libport/infer/frame_sort.hpp"

namespace porttape {

// Protocols whose frames are known (rules/framing.hpp), with what tells the kinds of their frames: rows of
// what a driver may write in turn.
struct KnownRow {
  std::string name;
  std::vector<FrameSort> sorts;
};
const std::vector<KnownRow>& known_rows();

}  // namespace porttape
