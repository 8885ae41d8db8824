// Names that have several addresses, or that nobody knows in time.

#include <chrono>
#include <condition_variable>
#include <dlfcn.h>
#include <map>
#include <memory>
#include <mutex>
#include <netdb.h>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/net/connector.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/sockets.hpp"

namespace {

// What is known of names here; one that is not in it is the C library's to look up.
const std::map<std::string, std::vector<std::string>> known_names{
    {"both.example", {"127.0.0.2", "127.0.0.1"}},
};

// A lookup of slow.example ends when it is let go.
class Brake {
 public:
  void hold() { set(true); }
  void let_go() { set(false); }
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return !holds_; });
  }

 private:
  void set(bool holds) {
    const std::lock_guard lock(mutex_);
    holds_ = holds;
    changed_.notify_all();
  }
  std::mutex mutex_;
  std::condition_variable changed_;
  bool holds_ = false;
};
Brake brake;

}  // namespace

// In the place of the C library's, for this program.
// NOLINTNEXTLINE(readability-inconsistent-declaration-parameter-name)
extern "C" int getaddrinfo(const char* host, const char* port, const addrinfo* hints, addrinfo** list) {
  static const auto real = reinterpret_cast<decltype(&getaddrinfo)>(::dlsym(RTLD_NEXT, "getaddrinfo"));
  const std::string name = host != nullptr ? host : "";
  if (name == "slow.example" && (hints->ai_flags & AI_NUMERICHOST) == 0) {
    brake.wait();
    return EAI_NONAME;
  }
  const auto known = known_names.find(name);
  if (known == known_names.end() || (hints->ai_flags & AI_NUMERICHOST) != 0)
    return real(host, port, hints, list);
  addrinfo** end = list;
  for (const std::string& address : known->second) {
    if (const int status = real(address.c_str(), port, hints, end); status != 0) return status;
    end = &(*end)->ai_next;
  }
  return 0;
}

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::Socket;

class ConnectorNames : public testing::Test {
 protected:
  void call(const std::string& host, std::uint16_t port, Nanos limit) {
    connector = std::make_unique<Connector>(loop, limit, [this](Result<UniqueFd> came) {
      result.emplace(std::move(came));
      connector.reset();
    });
    connector->to_host(host, port);
  }
  bool comes_within(Nanos time) {
    return let_pass(loop, clock, time, [this] { return result.has_value(); });
  }

  ManualClock clock;
  Loop loop{clock};
  std::optional<Result<UniqueFd>> result;
  std::unique_ptr<Connector> connector;
};

TEST_F(ConnectorNames, TheNextAddressIsTriedWhereOneRefuses) {
  const Socket server = Socket::listening();  // at 127.0.0.1, not at 127.0.0.2
  call("both.example", server.port(), seconds(10));
  EXPECT_TRUE(comes_within(Nanos(0)));
  ASSERT_TRUE(result->has_value());
  EXPECT_EQ(peer_address((*result)->get()).text(), "127.0.0.1:" + std::to_string(server.port()));
}

TEST_F(ConnectorNames, WhatEachAddressAnsweredIsTold) {
  const Socket deaf = Socket::bound();
  const std::string port = ":" + std::to_string(deaf.port());
  call("both.example", deaf.port(), seconds(10));
  EXPECT_TRUE(comes_within(Nanos(0)));
  ASSERT_FALSE(result->has_value());
  EXPECT_EQ(result->error().code, Errc::device_missing);
  EXPECT_EQ(result->error().message,
            "cannot connect to both.example" + port + ": 127.0.0.2" + port +
                ": Connection refused, 127.0.0.1" + port +
                ": Connection refused; nobody listens there; is the device switched on and the port right?");
}

// Both backlogs are full: the kernel answers nobody.
TEST_F(ConnectorNames, EachAddressHasItsShareOfTheTime) {
  const Socket full = Socket::listening(0);
  const Socket first = Socket::connect_to(full.port());
  const SocketAddress other = *numeric_address("127.0.0.2", full.port());
  const UniqueFd other_full(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  ASSERT_EQ(::bind(other_full.get(), other.get(), other.size), 0);
  ASSERT_EQ(::listen(other_full.get(), 0), 0);
  const Socket second = Socket::connect_to(other);
  call("both.example", full.port(), seconds(4));
  EXPECT_FALSE(comes_within(seconds(4) - Nanos(1)));
  EXPECT_TRUE(comes_within(Nanos(1)));
  const std::string port = ":" + std::to_string(full.port());
  EXPECT_EQ(result->error().message,
            "cannot connect to both.example" + port + ": 127.0.0.2" + port +
                ": Connection timed out, 127.0.0.1" + port +
                ": Connection timed out; it does not answer; check the address and firewalls");
}

TEST_F(ConnectorNames, AnAddressThatDoesNotAnswerLeavesTheNextOneHalfOfTheTime) {
  const Socket server = Socket::listening();
  const SocketAddress other = *numeric_address("127.0.0.2", server.port());
  const UniqueFd full(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  ASSERT_EQ(::bind(full.get(), other.get(), other.size), 0);
  ASSERT_EQ(::listen(full.get(), 0), 0);
  const Socket second = Socket::connect_to(other);
  call("both.example", server.port(), seconds(4));
  EXPECT_FALSE(comes_within(seconds(2) - Nanos(1)));
  EXPECT_TRUE(comes_within(Nanos(1)));
  EXPECT_TRUE(result->has_value());
}

TEST_F(ConnectorNames, ALookupThatTakesTooLongIsGivenUp) {
  brake.hold();
  call("slow.example", 2112, seconds(3));
  const auto turn = [this] {
    loop.clock_moved();
    while (loop.poll_one()) {
    }
  };
  clock.pass(seconds(3) - Nanos(1));
  turn();
  EXPECT_FALSE(result.has_value());
  clock.pass(Nanos(1));
  turn();
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->error().code, Errc::device_missing);
  EXPECT_EQ(result->error().message,
            "cannot connect to slow.example:2112: the name lookup takes too long; check the name server");
  result.reset();
  brake.let_go();
  settle(loop);
  EXPECT_FALSE(result.has_value()) << "what it finds in the end is for nobody";
}

TEST_F(ConnectorNames, ANameThatDoesNotResolveIsToldAsItIs) {
  brake.let_go();
  call("slow.example", 2112, seconds(3));
  EXPECT_TRUE(comes_within(Nanos(0)));
  EXPECT_EQ(result->error().code, Errc::device_missing);
  EXPECT_EQ(result->error().message, "the name 'slow.example' does not resolve (Name or service not known)");
}

}  // namespace
}  // namespace porttape
