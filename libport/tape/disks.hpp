#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <sys/types.h>

#include "libport/base/workers.hpp"

namespace porttape {

// What a process has learnt of its disks. Any thread may call.
class Disks {
 public:
  // Whether a write to this device (st_dev) once took longer than a line may wait. Stays true.
  [[nodiscard]] std::shared_ptr<const std::atomic<bool>> slow(dev_t device) { return flag_of(device); }
  void note_slow(dev_t device) { *flag_of(device) = true; }

  // Room for what waits in all queues together: false where there is none.
  static constexpr std::uint64_t kMostWaiting = std::uint64_t{256} << 20;
  [[nodiscard]] bool reserve(std::uint64_t bytes);
  void release(std::uint64_t bytes) { waiting_ -= bytes; }
  // The syncs of a device run one after another: side by side they take a thread each and are no faster. For
  // tapes of one Workers.
  [[nodiscard]] Workers::Strand sync_strand(dev_t device);

 private:
  std::shared_ptr<std::atomic<bool>> flag_of(dev_t device);

  std::mutex mutex_;
  std::map<dev_t, std::shared_ptr<std::atomic<bool>>> slow_;
  std::map<dev_t, Workers::Strand> sync_strands_;
  std::atomic<std::uint64_t> waiting_ = 0;
};

}  // namespace porttape
