#include "libport/port/loop.hpp"

#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>

namespace porttape {

// BOOST_ASIO_CONCURRENCY_HINT_UNSAFE_IO would also drop the reactor's locks, but post() from a second thread
// needs them.
Loop::Loop() : io_(std::make_unique<boost::asio::io_context>(1)) {}
Loop::~Loop() = default;

void Loop::run() { io_->run(); }
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
