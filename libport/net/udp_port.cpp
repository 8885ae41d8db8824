#include "libport/net/udp_port.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fmt/format.h>
#include <iostream>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>

#include "libport/base/printable.hpp"
#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

constexpr int kReadsATurn = 32;
constexpr std::uint64_t kMostReadAway = 65536;
constexpr int kMostPending = 4096;
constexpr int kReceiveBuffer = 1 << 20;  // the kernel drops what does not fit, and counts it (SO_RXQ_OVFL)
// A line that was hung up (its device cannot be reached, say) comes up for the next datagram after this.
constexpr Nanos kRestAfterHangUp = std::chrono::milliseconds(100);

// IPv4 and IPv6 sockets reach addresses of their own family only; with a destination it says which.
Result<std::vector<SocketAddress>> addresses_to_bind(const UdpOptions& options, int family) {
  const std::uint16_t port = options.own_port;
  const std::string& host = options.own_host;
  Result<std::vector<SocketAddress>> addresses =
      host == "*" || host.empty() ? any_addresses(port) : resolve(host, port);
  if (addresses && family != 0) {
    std::erase_if(*addresses, [family](const SocketAddress& address) { return address.family() != family; });
  }
  return addresses;
}

// None: errno tells why.
UniqueFd socket_at(const SocketAddress& address) {
  UniqueFd fd(::socket(address.family(), SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd) return fd;
  (void)::setsockopt(fd.get(), SOL_SOCKET, SO_RCVBUF, &kReceiveBuffer, sizeof kReceiveBuffer);
  const int on = 1;
  (void)::setsockopt(fd.get(), SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  if (::bind(fd.get(), address.get(), address.size) == 0) return fd;
  const int error = errno;
  fd.reset();
  errno = error;
  return fd;
}

bool only_peer(const PortContext& context, const UdpOptions& options) {
  if (options.from == UdpOptions::From::as_usual) return !context.pulled && !options.listen;
  return options.from == UdpOptions::From::peer;
}

}  // namespace

UdpPort::UdpPort(const PortContext& context, const CommonOptions& common, UdpOptions options)
    : context_(context),
      common_(common),
      options_(std::move(options)),
      from_peer_(only_peer(context, options_)),
      rest_timer_(*context.loop, [this] {
        if (opened_ && !up_) watch_->watch_readable(true);
      }) {}

UdpPort::~UdpPort() = default;

std::string UdpPort::name() const {
  return passive() ? "udp-listen:" + host_and_port(options_.own_host, options_.own_port)
                   : "udp:" + host_and_port(options_.to_host, options_.to_port);
}

PortPlace UdpPort::place() const {
  return passive() ? bound_ : PortPlace{.host = options_.to_host, .port = options_.to_port};
}

Result<void> UdpPort::prepare() {
  if (passive()) return bind_socket();
  // Known without a name server it decides the socket's family; a name that gives both is IPv4 here.
  const auto known = numeric_address(options_.to_host, options_.to_port);
  family_ = known ? known->family() : AF_INET;
  return bind_socket();
}

Result<void> UdpPort::bind_socket() {
  const Result<std::vector<SocketAddress>> addresses = addresses_to_bind(options_, family_);
  if (!addresses)
    return make_error(Errc::usage, fmt::format("option 'recv_ip': {}", addresses.error().message));
  int error = EAFNOSUPPORT;
  for (const SocketAddress& address : *addresses) {
    fd_ = socket_at(address);
    if (fd_) break;
    error = errno;
    if (error == EADDRINUSE) break;
  }
  if (!fd_) {
    return make_error(Errc::usage,
                      fmt::format("cannot receive on {}: {}; choose another recv_ip or recv_port",
                                  host_and_port(options_.own_host, options_.own_port), errno_text(error)));
  }
  const SocketAddress bound = local_address(fd_.get());
  family_ = bound.family();
  context_.log->info("receiving datagrams on {}", bound.text());
  if (options_.own_port == 0) {
    if (context_.announces) std::cout << bound.text() << std::endl;
    options_.own_port = bound.port();
  }
  bound_ = place_bound_at(bound);
  watch_.emplace(
      *context_.loop, fd_.get(), [this] { on_readable(); }, [this] { on_writable(); });
  return {};
}

void UdpPort::open() {
  opened_ = true;
  if (passive()) {
    watch_->watch_readable(true);
    return;
  }
  const std::uint16_t port = options_.to_port;
  if (const auto address = numeric_address(options_.to_host, port)) {
    resolved(std::vector<SocketAddress>{*address});
  } else {
    lookup_ = std::make_unique<NameLookup>(*context_.loop, options_.to_host, port,
                                           [this](const auto& addresses) { resolved(addresses); });
  }
}

void UdpPort::resolved(const Result<std::vector<SocketAddress>>& addresses) {
  if (!addresses) {
    listener().on_down({.reason = LineDown::Reason::failed, .error = addresses.error()});
    return;
  }
  const auto fitting = std::ranges::find(*addresses, family_, &SocketAddress::family);
  if (fitting == addresses->end()) {
    listener().on_down(
        {.reason = LineDown::Reason::failed,
         .error =
             make_error(Errc::device_missing,
                        fmt::format("{} has no address of the kind of recv_ip; give one of both as a number",
                                    in_quotes(options_.to_host)))});
    return;
  }
  peer_ = *fitting;
  discard_old();
  come_up();
}

// What came while nobody had the line open is not for this session.
void UdpPort::discard_old() {
  if (const Waiting old = read_away(); old.datagrams > 0)
    context_.log->info("{}: {} datagrams came while it was closed", name(), old.datagrams);
}

UdpPort::Waiting UdpPort::read_away() {
  const std::span<Byte> buffer = context_.loop->read_buffer();
  Waiting waiting;
  while (waiting.datagrams < kMostReadAway) {
    const ssize_t size = ::recv(fd_.get(), buffer.data(), buffer.size(), 0);
    if (size < 0) break;
    ++waiting.datagrams;
    waiting.bytes += static_cast<std::uint64_t>(size);
  }
  return waiting;
}

void UdpPort::come_up() {
  up_ = true;
  told_errors_.clear();
  empty_ = foreign_ = 0;
  watch_->watch_readable(reading_);
  listener().on_up();
}

void UdpPort::close() {
  opened_ = up_ = false;
  lookup_.reset();
  peer_.reset();
  rest_timer_.cancel();
  queue_gone();
  if (watch_) watch_->watch_readable(false);
  tell_losses();
}

void UdpPort::tell_losses() {
  ask_for_overflow();
  if (empty_ > 0)
    tell_lost(std::exchange(empty_, 0), "empty datagrams, which a tape cannot hold, were dropped");
  if (foreign_ > 0) {
    context_.log->warn("{}: {} datagrams of others than the peer were dropped", name(),
                       std::exchange(foreign_, 0));
  }
}

void UdpPort::tell_lost(std::uint64_t datagrams, const char* how) {
  const std::string text = fmt::format("{} {}", datagrams, how);
  context_.log->warn("{}: {}", name(), text);
  listener().told(line::Dropped{0, text});
}

std::optional<std::size_t> UdpPort::unread_by_peer() const {
  std::size_t bytes = 0;
  for (const Bytes& datagram : queue_) bytes += datagram.size();
  return bytes;
}

void UdpPort::queue_gone() {
  const std::size_t bytes = *unread_by_peer();
  queue_.clear();
  end_drains();
  if (watch_) watch_->watch_writable(false);
  if (bytes > 0) listener().told(line::Dropped{bytes, "they were not sent"});
}

void UdpPort::write(ByteView data) {
  if (!peer_ || !common_.writes) {
    listener().told(
        line::Dropped{data.size(), peer_ ? "the port is for reading only" : "the line is not up"});
    return;
  }
  for (; !data.empty(); data = data.subspan(std::min(kLargestDatagram, data.size()))) {
    send_or_queue(data.first(std::min(kLargestDatagram, data.size())));
  }
}

void UdpPort::send_or_queue(ByteView datagram) {
  if (queue_.empty() && send_one(datagram)) return;
  queue_.emplace_back(datagram.begin(), datagram.end());
  watch_->watch_writable(true);
}

bool UdpPort::send_one(ByteView datagram) {
  const ssize_t sent =
      ::sendto(fd_.get(), datagram.data(), datagram.size(), MSG_NOSIGNAL, peer_->get(), peer_->size);
  if (sent >= 0) return true;
  const int error = errno;
  if (error == EAGAIN || error == EINTR) return false;
  if (told_errors_.insert(error).second) {
    context_.log->warn("{}: a datagram of {} bytes to {} is dropped: {}", name(), datagram.size(),
                       peer_->text(), errno_text(error));
  }
  listener().told(line::Dropped{datagram.size(), "a datagram could not be sent"});
  return true;
}

void UdpPort::on_writable() {
  while (!queue_.empty() && send_one(queue_.front())) queue_.pop_front();
  if (!queue_.empty()) return;
  watch_->watch_writable(false);
  end_drains();
  if (up_) listener().on_drained();
}

void UdpPort::tell(const LineEvent& event) {
  const auto* const drain = std::get_if<line::Drain>(&event);
  if (drain == nullptr || !congested()) return Port::tell(event);
  drains_.push_back(drain->number);
}

// From the loop, since the caller may be in the midst of closing the line.
void UdpPort::end_drains() {
  for (const RequestNumber number : std::exchange(drains_, {})) {
    context_.loop->post([this, number, alive = std::weak_ptr<int>(alive_)] {
      if (!alive.expired()) listener().told(line::Sent{number});
    });
  }
}

bool UdpPort::discard() {
  queue_.clear();
  end_drains();
  watch_->watch_writable(false);
  (void)read_away();
  return true;
}

void UdpPort::set_reading(bool on) {
  reading_ = on;
  if (watch_ && up_) watch_->watch_readable(on);
}

void UdpPort::on_readable() {
  if (!up_) {  // the first datagram only opens the line: whether it is wanted yet, the listener says then
    SocketAddress sender;
    sender.size = sizeof sender.storage;
    Byte first = 0;
    if (::recvfrom(fd_.get(), &first, 1, MSG_PEEK, reinterpret_cast<sockaddr*>(&sender.storage),
                   &sender.size) < 0)
      return;
    peer_ = sender;
    context_.log->debug("{}: a datagram from {}", name(), sender.text());
    come_up();
  }
  for (int n = 0; n < kReadsATurn && up_ && reading_ && receive_one(); ++n) {
  }
}

bool UdpPort::receive_one() {
  const std::span<Byte> buffer = context_.loop->read_buffer();
  SocketAddress sender;
  iovec part{buffer.data(), buffer.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(std::uint32_t))> control{};
  msghdr message{};
  message.msg_name = &sender.storage;
  message.msg_namelen = sizeof sender.storage;
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = ::recvmsg(fd_.get(), &message, 0);
  if (size < 0) return errno == EINTR || errno == ECONNREFUSED;
  sender.size = message.msg_namelen;
  look_for_overflow(message);
  if (is_foreign(sender)) return true;
  if (passive()) peer_ = sender;
  if (size == 0) {
    ++empty_;
  } else if (!common_.reads) {
    listener().told(line::Dropped{static_cast<std::uint64_t>(size), "the port is for writing only"});
  } else {
    listener().on_data(ByteView(buffer).first(static_cast<std::size_t>(size)));
  }
  return true;
}

bool UdpPort::is_foreign(const SocketAddress& sender) {
  if (!from_peer_ || !peer_ || same_host_and_port(sender, *peer_)) return false;
  if (foreign_++ == 0) {
    context_.log->warn("{}: a datagram from {}, which is not the peer {}, is dropped; from=any takes all",
                       name(), sender.text(), peer_->text());
  }
  return true;
}

// The kernel's count of datagrams that found no room comes with the first one after them.
void UdpPort::look_for_overflow(msghdr& message) {
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part)) {
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SO_RXQ_OVFL) continue;
    std::uint32_t count = 0;
    std::memcpy(&count, CMSG_DATA(part), sizeof count);
    note_overflow(count);
  }
}

// Where none came after them.
void UdpPort::ask_for_overflow() {
  std::array<std::uint32_t, SK_MEMINFO_VARS> values{};
  socklen_t size = sizeof values;
  if (fd_ && ::getsockopt(fd_.get(), SOL_SOCKET, SO_MEMINFO, values.data(), &size) == 0)
    note_overflow(values[SK_MEMINFO_DROPS]);
}

// Datagrams that wait carry the count of when they came, which may be older than one asked for.
void UdpPort::note_overflow(std::uint32_t count) {
  const auto fresh = static_cast<std::int32_t>(count - overflow_);
  if (fresh <= 0) return;
  overflow_ = count;
  tell_lost(static_cast<std::uint64_t>(fresh), "datagrams came faster than they were read and are lost");
}

void UdpPort::read_pending() {
  for (int n = 0; n < kMostPending && up_ && reading_ && receive_one(); ++n) {
  }
}

void UdpPort::hang_up(bool) {
  queue_gone();
  if (!std::exchange(up_, false)) return;
  tell_losses();
  peer_.reset();
  watch_->watch_readable(false);
  // What waits was meant for this line; left there, it would open the next one.
  if (const Waiting waiting = read_away(); waiting.bytes > 0)
    listener().told(line::Dropped{waiting.bytes, "the line was hung up"});
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (alive.expired()) return;
    listener().on_down({.reason = LineDown::Reason::hung_up, .error = {}});
    if (opened_ && passive() && !up_) rest_timer_.set_after(kRestAfterHangUp);
  });
}

}  // namespace porttape
