#pragma once

#include <string>

#include "libport/rules/framing.hpp"

namespace porttape {

// What a frame is about, in a few printable characters, so that frames of one command have the same: of a
// known protocol what it calls so ("GPGGA", "unit 1 function 3", "class 01 message 07"); of text its first
// word; else the first bytes behind its start, in hex. `format` null: of no known form.
std::string frame_command(const FrameFormat* format, ByteView frame);

}  // namespace porttape
