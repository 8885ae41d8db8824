#include "libport/blocking/input_buffer.hpp"

#include <algorithm>

namespace porttape {

void InputBuffer::append(ByteView data, bool message) {
  if (data.empty()) return;
  if (begin_ >= bytes_.size() / 2) {
    bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(begin_));
    begin_ = 0;
  }
  bytes_.insert(bytes_.end(), data.begin(), data.end());
  if (message) messages_.push_back(data.size());
}

void InputBuffer::consume(std::size_t count) {
  begin_ += count;
  removed_ += count;
  while (count > 0 && !messages_.empty()) {
    const std::size_t taken = std::min(count, messages_.front());
    count -= taken;
    messages_.front() -= taken;
    if (messages_.front() == 0) messages_.pop_front();
  }
  if (empty()) clear();
}

void InputBuffer::clear() {
  removed_ += size();
  bytes_.clear();
  begin_ = 0;
  messages_.clear();
}

std::size_t InputBuffer::front_size() const { return messages_.empty() ? size() : messages_.front(); }

std::optional<std::size_t> InputBuffer::find(Byte wanted, std::size_t from) const {
  const ByteView all = view();
  if (from >= all.size()) return std::nullopt;
  const auto it = std::find(all.begin() + static_cast<std::ptrdiff_t>(from), all.end(), wanted);
  if (it == all.end()) return std::nullopt;
  return static_cast<std::size_t>(it - all.begin());
}

}  // namespace porttape
