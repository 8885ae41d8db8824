#include "libport/rules/frame_stream.hpp"

#include <algorithm>

namespace porttape {

std::optional<Micros> FrameStream::pause() const {
  std::optional<Micros> shortest;
  for (const FrameFormat& format : formats_) {
    if (format.kind == FrameFormat::Kind::idle)
      shortest = std::min(shortest.value_or(format.idle), format.idle);
  }
  return shortest;
}

void FrameStream::add(ByteView bytes, const Visit& visit) {
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  cut(false, visit);
}

void FrameStream::end(const Visit& visit) { cut(true, visit); }

void FrameStream::cut(bool ended, const Visit& visit) {
  FrameCutter cutter(formats_);
  while (cut_ < bytes_.size()) {
    const FrameCut found = cutter.cut(bytes_, cut_, ended);
    if (found.state == FrameCut::State::more) break;
    visit(found.format, ByteView(bytes_).subspan(cut_, found.size));
    cut_ += found.size;
  }
  bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(cut_));
  cut_ = 0;
}

}  // namespace porttape
