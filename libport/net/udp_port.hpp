#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <sys/socket.h>
#include <vector>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/timer.hpp"
#include "libport/net/name_lookup.hpp"
#include "libport/net/socket_address.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {

struct UdpOptions {
  std::string to_host = "127.0.0.1";  // dest_ip, dest_port
  std::uint16_t to_port = 20000;
  std::string own_host = "*";  // recv_ip, `*` for all
  std::uint16_t own_port = 20000;
  bool listen = false;
  enum class From : std::uint8_t { as_usual, peer, any };  // as_usual: see UdpPort
  From from = From::as_usual;
};

// Datagrams: each write() is one, each on_data() is one. Receives on `recv_ip`:`recv_port` and sends from
// there. With `from=peer` only the peer's datagrams count; those of others are dropped, told once a session
// and counted.
//
// Without `listen` it sends to `dest_ip`:`dest_port` and is up once that name has resolved. With `listen` it
// is passive: it comes up when the first datagram comes, and sends to whoever sent the latest (with
// `from=peer` the first, until the line goes down). UDP has no close: it is up until close() or hang_up().
//
// Empty datagrams are dropped (a tape cannot hold them), the kernel drops what comes faster than it is read;
// line::Dropped tells both, without bytes. Datagrams that the system does not take (too large, no route) are
// dropped and told as dropped; the line stays up. That nobody listens at the destination is not seen. More
// than 65507 bytes in one write(), which no datagram can hold, go as several.
class UdpPort final : public Port, private WaitingCalls {
 public:
  UdpPort(const PortContext& context, const CommonOptions& common, UdpOptions options);
  ~UdpPort() override;

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return !queue_.empty(); }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;  // what waits to be sent
  // A drain ends when the kernel has it all.
  void tell(const LineEvent& event) override;
  bool end_writing() override { return false; }
  [[nodiscard]] PortFacets facets() override { return {.waiting = this}; }
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] PortTraits traits() const override {
    return {.passive = options_.listen, .keeps_datagrams = true};
  }
  [[nodiscard]] std::string name() const override;
  [[nodiscard]] PortPlace place() const override;

 private:
  // A datagram is taken as a whole.
  std::size_t write_some(ByteView data) override {
    write(data);
    return data.size();
  }
  [[nodiscard]] std::size_t unsent() override { return 0; }
  bool discard() override;

  // What has come and was not read.
  struct Waiting {
    std::uint64_t datagrams = 0;
    std::uint64_t bytes = 0;
  };

  Result<void> bind_socket();
  void resolved(const Result<std::vector<SocketAddress>>& addresses);
  void discard_old();
  Waiting read_away();
  void come_up();
  void on_readable();
  bool receive_one();
  bool is_foreign(const SocketAddress& sender);
  void on_writable();
  void send_or_queue(ByteView datagram);
  bool send_one(ByteView datagram);  // false: later
  void queue_gone();
  void end_drains();
  void look_for_overflow(msghdr& message);
  void ask_for_overflow();
  void note_overflow(std::uint32_t count);
  void tell_losses();
  void tell_lost(std::uint64_t datagrams, const char* how);

  PortContext context_;
  const CommonOptions common_;
  UdpOptions options_;
  PortPlace bound_;
  const bool from_peer_;
  UniqueFd fd_;
  int family_ = 0;
  std::optional<FdWatch> watch_;
  std::unique_ptr<NameLookup> lookup_;
  std::optional<SocketAddress> peer_;
  std::deque<Bytes> queue_;
  std::vector<RequestNumber> drains_;  // that wait until the queue is empty
  std::set<int> told_errors_;          // each once a session
  std::uint64_t empty_ = 0;            // datagrams dropped since open()
  std::uint64_t foreign_ = 0;          // datagrams of others than the peer, dropped since open()
  std::uint32_t overflow_ = 0;         // datagrams lost in the kernel since bind, as told last
  Timer rest_timer_;
  bool opened_ = false;
  bool up_ = false;
  bool reading_ = true;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
