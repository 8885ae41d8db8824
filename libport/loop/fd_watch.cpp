#include "libport/loop/fd_watch.hpp"

#include <algorithm>
#include <array>
#include <poll.h>
#include <utility>

#include <boost/asio/error.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/basic_stream_descriptor.hpp>

#include "libport/loop/timer.hpp"

namespace porttape {

// The executor by its own type: the default one is erased, which costs each wait.
using Descriptor = boost::asio::posix::basic_stream_descriptor<boost::asio::io_context::executor_type>;

struct FdWatch::State : std::enable_shared_from_this<FdWatch::State> {
  struct Side {
    Descriptor::wait_type type;
    Callback callback;
    bool wanted = false;
    bool waiting = false;
    bool proven = false;  // an event was its own
  };

  State(Loop& owner, int fd, Callback on_readable, Callback on_writable, Callback on_hang_up)
      : loop(&owner),
        fence(owner.fence()),
        descriptor(owner.io()),
        number(fd),
        sides{Side{Descriptor::wait_read, std::move(on_readable)},
              Side{Descriptor::wait_write, std::move(on_writable)},
              Side{Descriptor::wait_error, std::move(on_hang_up)}} {
    boost::system::error_code refused;
    descriptor.assign(fd, refused);
    if (refused) look_by_clock();
  }

  void look_by_clock() {
    loop->within(fence, [this] { look_timer = std::make_unique<Timer>(*loop, [this] { look(); }); });
  }

  void watch(std::size_t index, bool on) {
    sides[index].wanted = on;
    if (on) wait(index);
  }

  void wait(std::size_t index) {
    Side& side = sides[index];
    if (side.waiting || gone) return;
    if (look_timer) {
      if (!look_timer->due()) look_timer->set_after(kLook);
      return;
    }
    side.waiting = true;
    descriptor.async_wait(side.type, [self = shared_from_this(),
                                      index](const boost::system::error_code& error) {
      Side& ready = self->sides[index];
      ready.waiting = false;
      if (self->gone || !ready.wanted) return;
      if (error == boost::asio::error::operation_not_supported) {  // a kind without events, as Asio tells it
        if (!self->look_timer) self->look_by_clock();
        return self->wait(index);
      }
      if (!self->is_own(index)) return self->wait(index);
      self->loop->came_from(self->number);
      self->loop->within(self->fence, ready.callback);
      if (!self->gone && ready.wanted) self->wait(index);
    });
  }

  // Whether an event is this descriptor's. Asio gives a new watch the place of one that has ended, and with
  // that an event of the ended one that is still in its queue. Only the first event can be such a one.
  bool is_own(std::size_t index) {
    constexpr std::array<short, 3> kinds{POLLIN, POLLOUT, POLLPRI};
    Side& side = sides[index];
    pollfd now{number, kinds[index], 0};
    if (!side.proven) side.proven = ::poll(&now, 1, 0) != 0;
    return side.proven;
  }

  // Where the kernel does not watch it.
  void look() {
    const auto self = shared_from_this();
    pollfd now{number, POLLIN | POLLOUT, 0};
    const bool there = ::poll(&now, 1, 0) > 0;
    const std::array<int, 3> events = {POLLIN | POLLHUP | POLLERR, POLLOUT | POLLHUP | POLLERR,
                                       POLLHUP | POLLERR};
    for (std::size_t index = 0; index < sides.size(); ++index) {
      if (there && (now.revents & events[index]) != 0 && sides[index].wanted && !gone)
        sides[index].callback();
    }
    const bool wanted = std::ranges::any_of(sides, &Side::wanted);
    if (!gone && wanted) look_timer->set_after(kLook);
  }

  void stop() {
    gone = true;
    if (look_timer) look_timer->cancel();
    if (descriptor.is_open()) descriptor.release();
  }

  Loop* loop;
  std::shared_ptr<Fence> fence;
  Descriptor descriptor;
  int number;
  std::unique_ptr<Timer> look_timer;
  std::array<Side, 3> sides;
  bool gone = false;
};

FdWatch::FdWatch(Loop& loop, int fd, Callback on_readable, Callback on_writable, Callback on_hang_up)
    : state_(std::make_shared<State>(loop, fd, std::move(on_readable), std::move(on_writable),
                                     std::move(on_hang_up))) {}

FdWatch::~FdWatch() { stop(); }

void FdWatch::stop() {
  if (state_->gone) return;
  state_->stop();
}

void FdWatch::watch_readable(bool on) { state_->watch(0, on); }
void FdWatch::watch_writable(bool on) { state_->watch(1, on); }
void FdWatch::watch_hang_up(bool on) { state_->watch(2, on); }

}  // namespace porttape
