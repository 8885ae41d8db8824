#pragma once

#include <functional>
#include <span>

#include "libport/rules/framing.hpp"

namespace porttape {

// Cuts one direction's bytes into frames, however they come in pieces. Memory: a piece and twice the longest
// frame.
class FrameStream {
 public:
  // Told a frame with the format that has it, or bytes of no frame with -1. Valid during the call.
  using Visit = std::function<void(int format, ByteView bytes)>;

  explicit FrameStream(std::vector<FrameFormat> formats) : formats_(std::move(formats)) {}

  [[nodiscard]] std::span<const FrameFormat> formats() const { return formats_; }
  // The shortest pause that ends a frame; nothing where none does.
  [[nodiscard]] std::optional<Micros> pause() const;

  void add(ByteView bytes, const Visit& visit);
  // Nothing came for so long that a frame is at its end, or nothing comes any more.
  void end(const Visit& visit);

 private:
  void cut(bool ended, const Visit& visit);

  std::vector<FrameFormat> formats_;
  Bytes bytes_;
  std::size_t cut_ = 0;  // of bytes_, before which all is told
};

}  // namespace porttape
