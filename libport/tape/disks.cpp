#include "libport/tape/disks.hpp"

namespace porttape {

std::shared_ptr<std::atomic<bool>> Disks::flag_of(dev_t device) {
  const std::lock_guard lock(mutex_);
  std::shared_ptr<std::atomic<bool>>& flag = slow_[device];
  if (!flag) flag = std::make_shared<std::atomic<bool>>(false);
  return flag;
}

bool Disks::reserve(std::uint64_t bytes) {
  if (waiting_ + bytes > kMostWaiting) return false;
  waiting_ += bytes;
  return true;
}

Workers::Strand Disks::sync_strand(dev_t device) {
  const std::lock_guard lock(mutex_);
  return sync_strands_[device];
}

}  // namespace porttape
