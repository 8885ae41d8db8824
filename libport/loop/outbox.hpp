#pragma once

#include <cstddef>
#include <functional>

#include "libport/base/bytes.hpp"
#include "libport/loop/fd_watch.hpp"

namespace porttape {

// The sending half of a stream descriptor: writes at once what the kernel takes and keeps the rest. Bounded
// by its users, who stop while congested(). A write error is reported with the number of bytes that it cost;
// no on_drained comes after it until discard() makes a new beginning. What the kernel has no memory for
// waits. Loop thread only.
class Outbox {
 public:
  enum class Kind { file, socket };  // of the descriptor; a socket whose peer is gone must not raise SIGPIPE

  // `watch` must call flush() when writable; it and `fd` must outlive the outbox.
  Outbox(int fd, Kind kind, FdWatch& watch, std::function<void()> on_drained,
         std::function<void(int error_number, std::size_t lost)> on_error);

  void write(ByteView data);
  // Sends what the kernel takes and keeps nothing; on_drained comes when it takes more.
  std::size_t write_some(ByteView data);
  void flush();    // from the watch
  void discard();  // also a new beginning after an error
  [[nodiscard]] bool congested() const { return sent_ < pending_.size(); }
  [[nodiscard]] std::size_t pending() const { return pending_.size() - sent_; }

 private:
  // Bytes sent of `data`; fewer when the kernel is full. Reports anything worse.
  std::size_t send(ByteView data);
  void forget_pending();

  int fd_;
  Kind kind_;
  FdWatch* watch_;
  std::function<void()> on_drained_;
  std::function<void(int, std::size_t)> on_error_;
  Bytes pending_;
  std::size_t sent_ = 0;
  bool broken_ = false;
};

}  // namespace porttape
