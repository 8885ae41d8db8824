#include "libport/loop/signal_watch.hpp"

#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>

namespace porttape {

struct SignalWatch::State : std::enable_shared_from_this<SignalWatch::State> {
  State(Loop& loop, std::function<void(int)> given) : set(loop.io()), callback(std::move(given)) {}

  void wait() {
    set.async_wait([self = shared_from_this()](const boost::system::error_code& error, int number) {
      if (error || self->gone) return;
      self->wait();
      self->callback(number);
    });
  }

  boost::asio::signal_set set;
  std::function<void(int)> callback;
  bool gone = false;
};

SignalWatch::SignalWatch(Loop& loop, std::function<void(int)> callback)
    : state_(std::make_shared<State>(loop, std::move(callback))) {
  state_->wait();
}

SignalWatch::~SignalWatch() {
  state_->gone = true;
  state_->set.cancel();
}

void SignalWatch::add(std::initializer_list<int> numbers) {
  for (const int number : numbers) state_->set.add(number);
}

}  // namespace porttape
