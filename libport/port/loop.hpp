#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/port/patience.hpp"

namespace boost::asio {
class io_context;
}

namespace porttape {

// The event loop that ports live on: one thread, the one that calls run(). Owns the io_context; outlives
// every port on it.
class Loop {
 public:
  Loop();
  ~Loop();
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  // Runs until stop() or until nothing is left to wait for. While events follow each other within
  // microseconds (a request, its answer, the next request) it polls for a moment before it sleeps: waking a
  // thread takes longer than such a wait.
  void run();
  // Waits for one event and handles it. False when there is nothing to wait for.
  bool run_one();
  // Handles one event if one is ready. False when none was.
  bool poll_one();
  void stop();
  void restart();

  // Calls `task` from run(), never from within post().
  void post(std::function<void()> task);

  // Room for one read, shared by all ports of the loop. What is in it counts until the next port reads.
  std::span<Byte> read_buffer();

  boost::asio::io_context& io() { return *io_; }
  [[nodiscard]] static Instant now() { return std::chrono::steady_clock::now(); }

 private:
  bool poll_from(Instant start);

  static constexpr std::size_t kReadBuffer = 65536;  // the largest datagram fits, and the largest tape block

  std::unique_ptr<boost::asio::io_context> io_;
  std::unique_ptr<Byte[]> read_buffer_;  // made when first asked for
  Patience patience_;
};

}  // namespace porttape
