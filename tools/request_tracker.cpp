#include "tools/request_tracker.hpp"

#include <algorithm>

namespace porttape {

RequestTracker::RequestTracker(const std::vector<TapeParts::Part>& parts, bool exact)
    : parts_(&parts), exact_(exact) {
  // What comes unasked at the beginning is there, whoever asks.
  std::uint64_t read = 0;
  for (; next_ < parts.size() && parts[next_].request.empty(); ++next_) {
    turns_.push_back({next_, read, 0});
    read += parts[next_].read;
  }
}

void RequestTracker::driver_was_sent(ByteView bytes) {
  read_ += bytes.size();
  asks_ = lost_ = false;
  pending_.clear();
}

void RequestTracker::driver_wrote(ByteView bytes) {
  const bool begins = !asks_;
  asks_ = true;
  written_ += bytes.size();
  if (!exact_) {
    if (begins && next_ == parts_->size()) beyond_ = true;
    if (begins && next_ < parts_->size()) begin(next_, written_ - bytes.size());
    return;
  }
  if (lost_) return;
  pending_.insert(pending_.end(), bytes.begin(), bytes.end());
  while (!pending_.empty() && take()) {
  }
}

RequestTracker::Fit RequestTracker::fit(std::size_t part) const {
  const Bytes& request = (*parts_)[part].request;
  if (request.empty()) return Fit::none;
  const std::size_t common = std::min(request.size(), pending_.size());
  if (!std::equal(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(common), request.begin()))
    return Fit::none;
  return common == request.size() ? Fit::whole : Fit::part_of;
}

void RequestTracker::begin(std::size_t part, std::uint64_t written) {
  turns_.push_back({part, read_, written});
  if (part >= next_) next_ = part + 1;
}

// A whole request, the next part's if it can be, else an earlier one's asked again, else a later one's.
// False: there is none yet.
bool RequestTracker::take() {
  bool may_come = false;
  const auto takes = [&](std::size_t part) {
    const Fit how = fit(part);
    may_come = may_come || how == Fit::part_of;
    if (how != Fit::whole) return false;
    if (next_ == parts_->size()) beyond_ = true;
    const std::size_t size = (*parts_)[part].request.size();
    begin(part, written_ - pending_.size());
    pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(size));
    return true;
  };
  if (next_ < parts_->size() && takes(next_)) return true;
  if (may_come) return false;  // the tape's own order comes first
  for (std::size_t part = next_; part-- > 0;) {
    if (takes(part)) return true;
  }
  for (std::size_t part = next_ + 1; part < parts_->size(); ++part) {
    if (takes(part)) return true;
  }
  if (may_come) return false;
  beyond_ = lost_ = true;
  if (unknown_.empty()) unknown_ = pending_;
  pending_.clear();
  return false;
}

}  // namespace porttape
