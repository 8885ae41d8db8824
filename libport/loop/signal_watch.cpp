#include "libport/loop/signal_watch.hpp"

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"

namespace porttape {
namespace {

// A signal as a byte: its number, with this bit where the kernel sent it itself.
constexpr unsigned char kFromKernel = 0x80;

// Where the handler, which knows nothing else, puts the bytes; -1 while nobody waits for them, which no write
// reaches.
std::atomic<int> handler_end = -1;
static_assert(std::atomic<int>::is_always_lock_free);

void on_signal(int number, siginfo_t* info, void*) {
  const int error = errno;
  const auto byte = static_cast<unsigned char>(number | (info->si_code == SI_KERNEL ? kFromKernel : 0));
  (void)!::write(handler_end, &byte, 1);
  errno = error;
}

struct Pipe {
  Pipe() {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_NONBLOCK | O_CLOEXEC) != 0)
      throw std::system_error(errno, std::generic_category(), "no pipe for signals");
    read.reset(ends[0]);
    write.reset(ends[1]);
  }
  UniqueFd read;
  UniqueFd write;
};

}  // namespace

struct SignalWatch::State : std::enable_shared_from_this<SignalWatch::State> {
  State(Loop& loop, std::function<void(int)> given)
      : callback(std::move(given)), watch(loop, pipe.read.get(), [this] { on_readable(); }) {}

  void on_readable() {
    const auto self = shared_from_this();  // a callback may end the watch
    std::array<unsigned char, 16> bytes{};
    const ssize_t size = ::read(pipe.read.get(), bytes.data(), bytes.size());
    for (ssize_t i = 0; i < size && !gone; ++i) {
      const unsigned char byte = bytes.at(static_cast<std::size_t>(i));
      from_kernel = (byte & kFromKernel) != 0;
      callback(byte & ~kFromKernel);
    }
  }

  Pipe pipe;
  std::function<void(int)> callback;
  FdWatch watch;
  bool gone = false;
  bool from_kernel = false;
};

SignalWatch::SignalWatch(Loop& loop, std::function<void(int)> callback)
    : state_(std::make_shared<State>(loop, std::move(callback))) {
  handler_end = state_->pipe.write.get();
  state_->watch.watch_readable(true);
}

SignalWatch::~SignalWatch() {
  handler_end = -1;
  state_->gone = true;
  state_->watch.stop();
}

void SignalWatch::add(std::initializer_list<int> numbers) {
  struct sigaction action {};
  action.sa_sigaction = on_signal;
  action.sa_flags = SA_RESTART | SA_SIGINFO;
  for (const int number : numbers) (void)::sigaction(number, &action, nullptr);
}

bool SignalWatch::from_terminal() const { return state_->from_kernel; }

}  // namespace porttape
