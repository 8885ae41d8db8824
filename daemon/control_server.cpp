#include "daemon/control_server.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/own_name.hpp"
#include "libport/base/peer_process.hpp"
#include "libport/loop/outbox.hpp"

namespace porttape {
namespace {

// Without descriptors, say.
constexpr Nanos kAcceptAgain = std::chrono::seconds(1);

}  // namespace

struct ControlServer::Client {
  Client(ControlServer& owner, UniqueFd taken)
      : fd(std::move(taken)),
        watch(
            *owner.loop_, fd.get(), [&owner] { owner.work(); }, [this] { outbox.flush(); }),
        outbox(
            fd.get(), Outbox::Kind::socket, watch, [&owner] { owner.wake(); },
            [this, &owner](int, std::size_t) {
              gone = true;
              owner.wake();
            }),
        active(owner.loop_->now()) {}

  // Takes what has come, as far as there is room for it. False: nothing has.
  bool read() {
    if (ended) return false;
    std::array<char, 4096> buffer;
    const ssize_t size = ::recv(fd.get(), buffer.data(), buffer.size(), 0);
    if (size > 0) input.append(buffer.data(), static_cast<std::size_t>(size));
    ended = size == 0;
    if (size < 0 && errno != EAGAIN && errno != EINTR) gone = true;
    return size >= 0;
  }
  // The next request; what came before the end without a newline is one too.
  std::optional<std::string> take_line() {
    const std::size_t newline = input.find('\n');
    if (newline == std::string::npos && !(ended && !input.empty())) return std::nullopt;
    std::string line = input.substr(0, newline);
    input.erase(0, newline == std::string::npos ? newline : newline + 1);
    return line;
  }
  [[nodiscard]] bool has_line() const { return input.find('\n') != std::string::npos; }
  [[nodiscard]] bool over() const { return gone || (ended && input.empty() && !outbox.congested()); }
  [[nodiscard]] bool is_read() const { return !ended && !has_line() && !outbox.congested(); }

  UniqueFd fd;
  FdWatch watch;
  Outbox outbox;
  std::string input;
  Instant active;
  bool ended = false;  // sends no more, and may still read
  bool gone = false;
};

ControlServer::ControlServer(Loop& loop, std::shared_ptr<spdlog::logger> log, ControlTarget& target,
                             ControlListener listener, Options options)
    : loop_(&loop),
      log_(std::move(log)),
      target_(&target),
      listener_(std::move(listener)),
      options_(std::move(options)),
      fence_(std::make_shared<Fence>()) {
  if (!options_.admits) options_.admits = is_own_or_root;
  fence_->on_exception = [this](const std::string& what) { threw(what); };
  loop_->within(fence_, [this] {
    watch_ = std::make_unique<FdWatch>(*loop_, listener_.fd(), [this] { work(); });
    rest_timer_ = std::make_unique<Timer>(*loop_, [this] { work(); });
    watch_->watch_readable(true);
  });
}

ControlServer::~ControlServer() = default;

// Something is to be done, but not from within what is going on. A rest goes on.
void ControlServer::wake() {
  if (!rest_timer_->due()) rest_timer_->set_after(Nanos::zero());
}

// One turn: a connection, and of each client what has come and one request, those first that were not served
// for the longest time.
void ControlServer::work() {
  const Instant began = loop_->now();
  if (std::exchange(broken_, false)) clients_.clear();
  Nanos shortest_rest = accept();
  std::size_t left = clients_.size();
  for (; left > 0 && loop_->now() - began < kTurn; --left) {
    if (serve(*clients_.front())) shortest_rest = std::max(shortest_rest, kShortestRest);
    clients_.splice(clients_.end(), clients_, clients_.begin());
  }
  std::erase_if(clients_, [](const std::unique_ptr<Client>& client) { return client->over(); });
  // Nothing else wakes it for those whose next request it has already.
  if (left > 0) shortest_rest = std::max(shortest_rest, kShortestRest);
  if (shortest_rest == Nanos::zero()) return listen();
  const Instant now = loop_->now();
  rest(now + std::max((now - began) * kRest, shortest_rest));
}

// Nobody is listened to until then; the next turn follows.
void ControlServer::rest(Instant until) {
  watch_->watch_readable(false);
  for (const auto& client : clients_) client->watch.watch_readable(false);
  rest_timer_->set(until);
}

// Until somebody has something to say.
void ControlServer::listen() {
  watch_->watch_readable(true);
  for (const auto& client : clients_) client->watch.watch_readable(client->is_read());
}

// How long to rest after it: zero where nobody came.
Nanos ControlServer::accept() {
  UniqueFd fd(::accept4(listener_.fd(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (!fd) {
    if (errno == EAGAIN) return Nanos::zero();
    if (errno == EINTR || errno == ECONNABORTED) return kShortestRest;
    const int error = errno;
    if (!std::exchange(accept_told_, true))
      log_->warn("control socket {}: a connection cannot be accepted: {}", listener_.path(),
                 errno_text(error));
    return kAcceptAgain;
  }
  if (const auto peer = peer_process(fd.get()); !peer || !options_.admits(peer->uid)) {
    const std::string no =
        control_usage_error("this daemon is another user's; ask as that user or as root") + '\n';
    (void)::send(fd.get(), no.data(), no.size(), MSG_NOSIGNAL);
    return kShortestRest;
  }
  make_room();
  loop_->within(fence_, [&] { clients_.push_front(std::make_unique<Client>(*this, std::move(fd))); });
  return kShortestRest;
}

void ControlServer::make_room() {
  if (clients_.size() < kMostClients) return;
  const auto silent =
      std::ranges::min_element(clients_, {}, [](const auto& client) { return client->active; });
  clients_.erase(silent);
}

// Whether there was anything to do.
bool ControlServer::serve(Client& client) {
  if (client.gone || client.outbox.congested()) return false;
  const bool came = !client.has_line() && client.read();
  const std::optional<std::string> line = client.take_line();
  const bool too_long = line ? line->size() > kMostLine : client.input.size() > kMostLine;
  if (too_long) {
    const std::string no =
        control_usage_error("a request has at most " + std::to_string(kMostLine) + " bytes") + '\n';
    client.outbox.write(as_bytes(no));
    client.gone = true;
  } else if (line) {
    client.active = loop_->now();
    client.outbox.write(as_bytes(control_reply(*target_, *line) + '\n'));
  }
  return came || line.has_value();
}

void ControlServer::threw(const std::string& what) {
  log_->warn("control socket {}: {}; its clients are sent away", listener_.path(), what);
  broken_ = true;
  rest(loop_->now() + kAcceptAgain);
}

}  // namespace porttape
