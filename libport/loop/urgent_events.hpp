#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "libport/base/unique_fd.hpp"

namespace porttape {

// Answers a descriptor's urgent events (EPOLLPRI: a pty's master has a status; a hang-up) within
// microseconds, whatever the loop is busy with, on a thread of its own for all ports of a loop. The thread is
// there while anything is watched, sleeps but for these events, and has real-time priority where that is
// permitted.
//
// Best effort: an event that the loop has read before the thread woke is not answered here. Loop thread only.
class UrgentEvents {
 public:
  // Called on the thread with a duplicate of the descriptor: one short system call that is right at any time.
  using Answer = void (*)(int fd);

  class Watch {
   public:
    Watch(UrgentEvents& events, std::uint64_t id) : events_(&events), id_(id) {}
    ~Watch() { events_->remove(id_); }
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

   private:
    UrgentEvents* events_;
    std::uint64_t id_;
  };

  UrgentEvents() = default;
  ~UrgentEvents();
  UrgentEvents(const UrgentEvents&) = delete;
  UrgentEvents& operator=(const UrgentEvents&) = delete;

  // Until it is destroyed. Null where no thread or descriptor is to be had.
  [[nodiscard]] std::unique_ptr<Watch> watch(int fd, Answer answer);

 private:
  struct Member {
    UniqueFd fd;  // a duplicate: that of the caller may be closed at any time
    Answer answer = nullptr;
  };

  bool start();
  void stop();
  void run();
  void answer_for(std::uint64_t id);
  void remove(std::uint64_t id);

  std::mutex mutex_;  // of members_
  std::map<std::uint64_t, Member> members_;
  std::uint64_t next_id_ = 1;  // 0: the wake-up
  std::atomic<bool> stopping_ = false;
  UniqueFd epoll_;
  UniqueFd wake_;
  std::thread thread_;
};

}  // namespace porttape
