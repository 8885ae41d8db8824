#include "libport/port/loop.hpp"

#include <chrono>
#include <sched.h>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>

namespace porttape {
namespace {

// How long a loop polls before it sleeps, and after which part of that it lets others run.
constexpr Nanos kPollLimit = std::chrono::microseconds(25);
constexpr Nanos kPollAlone = std::chrono::microseconds(2);

}  // namespace

// BOOST_ASIO_CONCURRENCY_HINT_UNSAFE_IO would also drop the reactor's locks, but post() from a second thread
// needs them.
Loop::Loop() : io_(std::make_unique<boost::asio::io_context>(1)) {}
Loop::~Loop() = default;

void Loop::run() {
  for (;;) {
    const Instant idle_since = now();
    if (patience_.expects_soon(idle_since) && poll_from(idle_since)) continue;
    if (io_->run_one() == 0) return;
    patience_.waited(now() - idle_since);
  }
}

// True once an event was handled.
bool Loop::poll_from(Instant start) {
  for (Instant last = start; !io_->stopped();) {
    if (io_->poll_one() != 0) return true;
    const Instant next = now();
    patience_.polled(last, next);
    if (!patience_.expects_soon(next) || next - start >= kPollLimit) return false;
    if (next - start >= kPollAlone) ::sched_yield();  // the peer may be waiting for this very processor
    last = next;
  }
  return false;
}

bool Loop::run_one() { return io_->run_one() != 0; }
bool Loop::poll_one() { return io_->poll_one() != 0; }
void Loop::stop() { io_->stop(); }
void Loop::restart() { io_->restart(); }

std::span<Byte> Loop::read_buffer() {
  if (!read_buffer_) read_buffer_ = std::make_unique<Byte[]>(kReadBuffer);
  return {read_buffer_.get(), kReadBuffer};
}

void Loop::post(std::function<void()> task) { boost::asio::post(*io_, std::move(task)); }

}  // namespace porttape
