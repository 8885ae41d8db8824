#include "libport/net/connector.hpp"

#include <cerrno>
#include <fmt/format.h>
#include <utility>

#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

std::string advice_for(int error_number) {
  switch (error_number) {
    case ECONNREFUSED:
      return "nobody listens there; is the device switched on and the port right?";
    case ENETUNREACH:
    case EHOSTUNREACH:
      return "check the network and the address";
    case ETIMEDOUT:
      return "it does not answer; check the address and firewalls";
    default:
      return "check the address";
  }
}

}  // namespace

Connector::Connector(Loop& loop, Nanos limit, Callback callback)
    : loop_(&loop),
      callback_(std::move(callback)),
      deadline_(loop_->now() + limit),
      timer_(loop, [this] { on_timer(); }) {}

void Connector::to_host(const std::string& host, std::uint16_t port) {
  target_ = host_and_port(host, port);
  if (const auto address = numeric_address(host, port)) {
    to_address(*address);
    return;
  }
  timer_.set(deadline_);
  lookup_ = std::make_unique<NameLookup>(*loop_, host, port, [this](const auto& addresses) {
    if (!addresses) return end(addresses.error());
    addresses_ = *addresses;
    next_address();
  });
}

void Connector::to_address(const SocketAddress& address) {
  if (target_.empty()) target_ = address.text();
  addresses_ = {address};
  timer_.set(loop_->now());  // from the loop, never from within this call
}

void Connector::next_address() {
  const Nanos left = deadline_ - loop_->now();
  const auto sharers = static_cast<Nanos::rep>(addresses_.size() - next_);
  timer_.set_after(left / sharers);
  attempt(addresses_[next_++]);
}

void Connector::attempt(const SocketAddress& address) {
  fd_.reset(::socket(address.family(), SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd_) return attempt_ended(errno);
  // EAGAIN: a Unix listener whose backlog is full.
  if (::connect(fd_.get(), address.get(), address.size) == 0) return attempt_ended(0);
  if (errno != EINPROGRESS) return attempt_ended(errno);
  watch_ = std::make_unique<FdWatch>(
      *loop_, fd_.get(), [] {},
      [this] {
        int error = 0;
        socklen_t size = sizeof error;
        (void)::getsockopt(fd_.get(), SOL_SOCKET, SO_ERROR, &error, &size);
        attempt_ended(error);
      });
  watch_->watch_writable(true);
}

void Connector::attempt_ended(int error_number) {
  if (watch_) watch_->stop();
  if (error_number == 0) return end(std::move(fd_));
  fd_.reset();
  if (!failures_.empty()) failures_ += ", ";
  const std::string where = addresses_.size() > 1 ? addresses_[next_ - 1].text() + ": " : std::string();
  failures_ += where + errno_text(error_number);
  if (next_ < addresses_.size()) return next_address();
  end(make_error(Errc::device_missing,
                 fmt::format("cannot connect to {}: {}; {}", target_, failures_, advice_for(error_number))));
}

void Connector::on_timer() {
  if (addresses_.empty()) {
    return end(make_error(
        Errc::device_missing,
        fmt::format("cannot connect to {}: the name lookup takes too long; check the name server", target_)));
  }
  if (next_ == 0) return next_address();
  attempt_ended(ETIMEDOUT);
}

void Connector::end(Result<UniqueFd> result) {
  timer_.cancel();
  // The callback may destroy this object, and with it the function.
  const Callback callback = std::exchange(callback_, {});
  callback(std::move(result));
}

}  // namespace porttape
