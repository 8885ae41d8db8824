#include "libport/tty/last_close.hpp"

#include <sys/epoll.h>

namespace porttape {

LastClose::LastClose(int master) : epoll_(::epoll_create1(EPOLL_CLOEXEC)) {
  epoll_event hang_up{};
  hang_up.events = EPOLLET;  // a hang-up is told unasked
  if (epoll_ && ::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, master, &hang_up) != 0) epoll_.reset();
  (void)take();  // nobody had it open yet
}

bool LastClose::take() {
  if (!epoll_) return false;
  epoll_event event{};
  return ::epoll_wait(epoll_.get(), &event, 1, 0) > 0 && (event.events & EPOLLHUP) != 0;
}

}  // namespace porttape
