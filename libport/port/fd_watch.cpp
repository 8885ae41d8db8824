#include "libport/port/fd_watch.hpp"

#include <array>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/basic_stream_descriptor.hpp>

namespace porttape {

// The executor by its own type: the default one is erased, which costs each wait.
using Descriptor = boost::asio::posix::basic_stream_descriptor<boost::asio::io_context::executor_type>;

struct FdWatch::State : std::enable_shared_from_this<FdWatch::State> {
  struct Side {
    Descriptor::wait_type type;
    Callback callback;
    bool wanted = false;
    bool waiting = false;
  };

  State(Loop& owner, int fd, Callback on_readable, Callback on_writable)
      : loop(&owner),
        descriptor(owner.io(), fd),
        sides{Side{Descriptor::wait_read, std::move(on_readable)},
              Side{Descriptor::wait_write, std::move(on_writable)}} {}

  void watch(std::size_t index, bool on) {
    sides[index].wanted = on && !gone;
    if (on) wait(index);
  }

  void wait(std::size_t index) {
    Side& side = sides[index];
    if (side.waiting || gone) return;
    side.waiting = true;
    descriptor.async_wait(side.type, [self = shared_from_this(), index](const boost::system::error_code&) {
      Side& ready = self->sides[index];
      ready.waiting = false;
      if (self->gone || !ready.wanted) return;
      self->loop->handler_begins();
      ready.callback();
      if (!self->gone && ready.wanted) self->wait(index);
    });
  }

  Loop* loop;
  Descriptor descriptor;
  std::array<Side, 2> sides;
  bool gone = false;
};

FdWatch::FdWatch(Loop& loop, int fd, Callback on_readable, Callback on_writable)
    : state_(std::make_shared<State>(loop, fd, std::move(on_readable), std::move(on_writable))) {}

FdWatch::~FdWatch() { stop(); }

void FdWatch::stop() {
  if (state_->gone) return;
  state_->gone = true;
  state_->descriptor.release();
}

void FdWatch::watch_readable(bool on) { state_->watch(0, on); }
void FdWatch::watch_writable(bool on) { state_->watch(1, on); }

}  // namespace porttape
