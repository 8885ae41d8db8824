#pragma once

#include <array>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <fcntl.h>
#include <mutex>
#include <optional>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tty/line_calls.hpp"

namespace porttape {

// A serial device that a test plays. What comes to it is its journal: bytes, `[rts+]` for a signal, `(sent)`
// where somebody has waited for that.
class PlayedLine final : public LineCalls {
 public:
  PlayedLine() {
    std::array<int, 2> ends{};
    EXPECT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
    changes_.reset(ends[0]);
    change_.reset(ends[1]);
  }

  // The device does it. `seen`: a wait for a change ends by it.
  void change(int lines, const SignalCounts& counts = {}, bool seen = true) {
    {
      const std::lock_guard lock(mutex_);
      lines_ = lines;
      counts_ = counts;
    }
    if (seen) end_wait();
  }
  void end_wait() const { EXPECT_EQ(::write(change_.get(), "x", 1), 1); }
  void lose_lines() {
    const std::lock_guard lock(mutex_);
    lines_.reset();
  }
  // A wait for a change is not ended by anything but release().
  void hang() {
    const std::lock_guard lock(mutex_);
    hangs_ = true;
  }
  void release() {
    const std::lock_guard lock(mutex_);
    hangs_ = false;
    released_.notify_all();
  }

  std::string journal() {
    const std::lock_guard lock(mutex_);
    read_bytes();
    return journal_;
  }

  int set(int, const LineSignal& signal) override {
    const std::lock_guard lock(mutex_);
    read_bytes();
    journal_ += "[" + std::string(name_of(signal.name)) + (signal.on ? "+]" : "-]");
    return error;
  }
  int ask(int, const LineRequest& request, LineAnswer& answer) override {
    const std::lock_guard lock(mutex_);
    read_bytes();
    const bool rs485 =
        request.kind == LineRequest::Kind::get_rs485 || request.kind == LineRequest::Kind::set_rs485;
    const bool makes =
        request.kind == LineRequest::Kind::set_rs485 || request.kind == LineRequest::Kind::set_serial;
    journal_ += std::string(makes ? "[set " : "[get ") + (rs485 ? "rs485]" : "serial]");
    if (ask_error != 0) return ask_error;
    if (request.kind == LineRequest::Kind::set_rs485) rs485_ = request.rs485;
    if (request.kind == LineRequest::Kind::set_serial) serial_ = request.serial;
    answer.serial = serial_;
    answer.rs485 = rs485_;
    return 0;
  }
  std::size_t unsent(int) override { return queued; }
  bool wait_until_sent(int fd, Nanos) override {
    const std::lock_guard lock(mutex_);
    const int flags = ::fcntl(fd, F_GETFD);
    EXPECT_TRUE(flags < 0 || (flags & FD_CLOEXEC) != 0) << "a program that is started would have it";
    read_bytes();
    if (moves) journal_ += "(sent)";
    return moves;
  }
  std::optional<int> modem_lines(int) override {
    const std::lock_guard lock(mutex_);
    ++looks;
    return lines_;
  }
  std::optional<SignalCounts> counts(int) override {
    const std::lock_guard lock(mutex_);
    return counts_;
  }
  int wait_for_change(int) override {
    {
      std::unique_lock lock(mutex_);
      ++waits;
      released_.wait(lock, [this] { return !hangs_; });
    }
    if (wait_error != 0 || never_waits) return wait_error;
    char change = 0;
    return ::read(changes_.get(), &change, 1) == 1 ? 0 : errno;
  }

  int device = -1;             // where bytes come out: a pty's master
  std::atomic<int> error = 0;  // of set()
  std::atomic<int> ask_error = 0;
  std::atomic<std::size_t> queued = 0;
  std::atomic<bool> moves = true;  // what wait_until_sent() gives
  std::atomic<int> wait_error = 0;
  std::atomic<bool> never_waits = false;
  std::atomic<int> looks = 0;
  std::atomic<int> waits = 0;

 private:
  void read_bytes() {
    char bytes[4096];
    for (ssize_t size = 1; device >= 0 && size > 0;) {
      size = ::read(device, bytes, sizeof bytes);
      if (size > 0) journal_.append(bytes, static_cast<std::size_t>(size));
    }
  }

  std::mutex mutex_;
  std::condition_variable released_;
  std::string journal_;
  std::optional<int> lines_ = 0;
  serial_struct serial_{};
  serial_rs485 rs485_{};
  std::optional<SignalCounts> counts_ = SignalCounts{};
  bool hangs_ = false;
  UniqueFd changes_;
  UniqueFd change_;
};

}  // namespace porttape
