#include "daemon/control_server.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <functional>
#include <iterator>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/told_target.hpp"
#include "tests/support/next_call.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace {
// Is called, once, by the next accept4() of this program before it looks.
std::function<void()> before_accept;
}  // namespace

extern "C" int accept4(int fd, sockaddr* address, socklen_t* size, int flags) {
  if (before_accept) std::exchange(before_accept, nullptr)();
  static const auto next = porttape::next_call<decltype(&accept4)>("accept4");
  return next(fd, address, size, flags);
}

namespace porttape {
namespace {

using test::TempDir;
using test::ToldTarget;
using testing::HasSubstr;

constexpr const char* kStatus = "{\"verb\":\"status\"}\n";
constexpr const char* kReply = "{\"ok\":true,\"status\":{\"pid\":7}}\n";

class ControlServerTest : public testing::Test {
 protected:
  void serve(std::function<bool(uid_t)> admits = {}) {
    Result<ControlListener> listener = ControlListener::create({folder(), false, 0700});
    ASSERT_TRUE(listener) << listener.error().message;
    path_ = listener->path();
    server_ = std::make_unique<ControlServer>(loop_, book_.log(), target, std::move(*listener),
                                              ControlServer::Options{std::move(admits)});
  }
  [[nodiscard]] std::string folder() const { return dir_ / "control"; }

  [[nodiscard]] UniqueFd connect() const {
    UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const auto address = socket_address(path_);
    EXPECT_EQ(::connect(fd.get(), reinterpret_cast<const sockaddr*>(&*address), sizeof *address), 0);
    return fd;
  }
  // Sends while the server takes it; how much that was.
  std::size_t send(const UniqueFd& fd, const std::string& text) {
    std::size_t sent = 0;
    const Instant limit = machine_clock().now() + std::chrono::seconds(60);
    for (int full = 0; sent < text.size() && full < 200 && machine_clock().now() < limit;) {
      const ssize_t part = ::send(fd.get(), text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
      if (part < 0 && errno != EAGAIN) break;
      if (part > 0) {
        sent += static_cast<std::size_t>(part);
        full = 0;
      } else {
        ++full;
        turn();
      }
    }
    return sent;
  }
  // So many lines, or what comes up to the end.
  std::string read(const UniqueFd& fd, std::ptrdiff_t lines) {
    std::string text;
    const Instant limit = machine_clock().now() + std::chrono::seconds(60);
    while (std::ranges::count(text, '\n') < lines && machine_clock().now() < limit) {
      std::array<char, 65536> buffer;
      const ssize_t size = ::recv(fd.get(), buffer.data(), buffer.size(), 0);
      if (size > 0) text.append(buffer.data(), static_cast<std::size_t>(size));
      if (size == 0 || (size < 0 && errno != EAGAIN)) return text;
      if (size < 0) turn();
    }
    return text;
  }
  std::string ask(const UniqueFd& fd, const std::string& text) {
    send(fd, text);
    return read(fd, 1);
  }
  void turn() {
    Timer later(loop_, [] {});
    later.set_after(std::chrono::milliseconds(1));
    (void)loop_.run_one();
  }

  ToldTarget target;
  TempDir dir_;
  LogBook book_;
  Loop loop_;
  std::string path_;
  std::unique_ptr<ControlServer> server_;
};

TEST_F(ControlServerTest, AnswersEachLineOfSeveralClients) {
  serve();
  const UniqueFd one = connect();
  const UniqueFd other = connect();
  EXPECT_EQ(ask(one, kStatus), kReply);
  EXPECT_EQ(ask(other, kStatus), kReply);
  send(one, std::string("{\"verb\":\"mark\",\"text\":\"a\"}\n") + kStatus);
  EXPECT_THAT(read(one, 2), HasSubstr(kReply));
  EXPECT_EQ(target.calls, "mark(,a) ");
}

TEST_F(ControlServerTest, ATurnThatIsOverAtOnceForgetsNoRequest) {
  serve();
  const UniqueFd fd = connect();
  EXPECT_EQ(ask(fd, kStatus), kReply);
  // The thread is put aside where the turn of the second request begins.
  target.on_status = [] {
    before_accept = [] {
      const Instant until = machine_clock().now() + 2 * ControlServer::kTurn;
      while (machine_clock().now() < until) {
      }
    };
  };
  send(fd, std::string(kStatus) + kStatus);
  EXPECT_EQ(read(fd, 2), std::string(kReply) + kReply);
  before_accept = nullptr;
}

TEST_F(ControlServerTest, AClientThatEndsItsSideGetsItsReply) {
  serve();
  const UniqueFd fd = connect();
  send(fd, "{\"verb\":\"status\"}");  // without its newline
  ::shutdown(fd.get(), SHUT_WR);
  EXPECT_EQ(read(fd, 2), kReply);  // up to the end
}

// The kernel resets a connection whose end has left something unread.
TEST_F(ControlServerTest, ARequestThatABrokenConnectionCutsOffIsNotCarriedOut) {
  serve();
  const auto open_files = [] {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  };
  EXPECT_EQ(ask(connect(), kStatus), kReply);
  for (int turns = 0; turns < 100; ++turns) turn();
  const auto before = open_files();
  {
    const UniqueFd fd = connect();
    send(fd, kStatus);
    pollfd replied{fd.get(), POLLIN, 0};
    while (::poll(&replied, 1, 0) == 0) turn();
    send(fd, R"({"verb":"mark","text":"a"})");  // without its newline: the rest never comes
  }
  for (int turns = 0; turns < 1000 && open_files() > before; ++turns) turn();
  EXPECT_EQ(open_files(), before);
  EXPECT_EQ(target.calls, "");
}

TEST_F(ControlServerTest, TheSocketIsItsOwnersAloneAndGoesWithIt) {
  serve();
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  ASSERT_EQ(::stat(folder().c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0700U);
  server_.reset();
  EXPECT_NE(::stat(path_.c_str(), &status), 0);
}

TEST_F(ControlServerTest, AnotherUserIsRefused) {
  uid_t asked = 12345;
  serve([&asked](uid_t user) {
    asked = user;
    return false;
  });
  const UniqueFd fd = connect();
  EXPECT_THAT(read(fd, 2),
              HasSubstr("{\"ok\":false,\"kind\":\"usage\",\"error\":\"this daemon is another user's"));
  EXPECT_EQ(asked, ::geteuid());
  EXPECT_EQ(target.calls, "");
}

TEST_F(ControlServerTest, ALineWithoutAnEndIsRefusedBeforeItIsKept) {
  serve();
  const UniqueFd fd = connect();
  const std::size_t sent = send(fd, std::string(10 << 20, 'x'));
  EXPECT_LT(sent, 2U << 20U);  // what the kernel holds, and a line
  EXPECT_THAT(read(fd, 2), HasSubstr("at most 32768 bytes"));
  EXPECT_EQ(ask(connect(), kStatus), kReply);
}

TEST_F(ControlServerTest, AClientThatDoesNotReadItsRepliesIsNotRead) {
  target.state = "{\"x\":\"" + std::string(100'000, 'x') + "\"}";
  serve();
  const UniqueFd fd = connect();
  int asked = 0;
  target.on_status = [&asked] { ++asked; };
  std::string flood;
  for (int n = 0; n < 100'000; ++n) flood += kStatus;
  EXPECT_LT(send(fd, flood), flood.size());
  EXPECT_LT(asked, 50);
  target.state = R"({"pid":7})";
  EXPECT_EQ(ask(connect(), kStatus), kReply);  // nobody else is in its way
}

TEST_F(ControlServerTest, AFloodLeavesTheLoopToTheLines) {
  serve();
  std::vector<UniqueFd> flooding;
  std::string flood;
  for (int n = 0; n < 2000; ++n) flood += kStatus;
  for (int n = 0; n < 8; ++n) flooding.push_back(connect());
  int asked = 0;
  Nanos busy{};
  target.on_status = [&] {
    ++asked;
    const Instant until = machine_clock().now() + std::chrono::microseconds(100);
    while (machine_clock().now() < until) {
    }
    busy += std::chrono::microseconds(100);
  };
  const Instant begin = machine_clock().now();
  while (asked < 100) {
    for (const UniqueFd& fd : flooding) {
      (void)::send(fd.get(), flood.data(), flood.size(), MSG_NOSIGNAL);
      std::array<char, 65536> buffer;
      (void)::recv(fd.get(), buffer.data(), buffer.size(), 0);
    }
    turn();
  }
  EXPECT_GE(machine_clock().now() - begin, busy * (ControlServer::kRest - 1));
}

TEST_F(ControlServerTest, OneClientTooManyTakesThePlaceOfASilentOne) {
  serve();
  std::vector<UniqueFd> clients;
  for (std::size_t n = 0; n < ControlServer::kMostClients; ++n) {
    clients.push_back(connect());
    if (n > 0) {
      EXPECT_EQ(ask(clients.back(), kStatus), kReply);
    }
  }
  EXPECT_EQ(ask(clients[1], kStatus), kReply);
  const UniqueFd more = connect();
  EXPECT_EQ(ask(more, kStatus), kReply);
  EXPECT_EQ(read(clients[0], 1), "");  // sent away
  EXPECT_EQ(ask(clients[1], kStatus), kReply);
}

TEST_F(ControlServerTest, AnExceptionEndsItsClientsOnly) {
  serve();
  const UniqueFd fd = connect();
  target.on_status = [] { throw std::runtime_error("no memory"); };
  EXPECT_EQ(ask(fd, kStatus), "");
  EXPECT_THAT(book_.text(), HasSubstr("no memory"));
  target.on_status = {};
  EXPECT_EQ(ask(connect(), kStatus), kReply);
}

using ControlListenerTest = ControlServerTest;

TEST_F(ControlListenerTest, AStaleSocketOfThePastIsReplaced) {
  serve();
  const std::string left = path_ + ".left";
  ASSERT_EQ(::link(path_.c_str(), left.c_str()), 0);
  server_.reset();
  ASSERT_EQ(::rename(left.c_str(), path_.c_str()), 0);
  EXPECT_TRUE(is_stale_socket(path_));
  serve();
  EXPECT_FALSE(is_stale_socket(path_));
  EXPECT_EQ(ask(connect(), kStatus), kReply);
}

TEST_F(ControlListenerTest, ASocketInUseIsLeftAlone) {
  serve();
  const Result<ControlListener> second = ControlListener::create({folder(), false, 0700});
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("in use"));
  EXPECT_EQ(ask(connect(), kStatus), kReply);
}

TEST_F(ControlListenerTest, WhatHasItsNameByThenIsNotRemoved) {
  serve();
  ASSERT_EQ(::unlink(path_.c_str()), 0);
  test::write_file(path_, {});
  server_.reset();
  EXPECT_EQ(::unlink(path_.c_str()), 0);
}

TEST_F(ControlListenerTest, AFolderThatOthersCouldUseIsRefused) {
  const auto why = [](const std::string& path) {
    const Result<ControlListener> made = ControlListener::create({path, false, 0700});
    return made ? std::string() : made.error().message;
  };
  ASSERT_EQ(::mkdir(folder().c_str(), 0700), 0);
  ASSERT_EQ(::chmod(folder().c_str(), 0770), 0);
  EXPECT_THAT(why(folder()), HasSubstr("others have access"));
  ASSERT_EQ(::symlink(folder().c_str(), (dir_ / "link").c_str()), 0);
  EXPECT_THAT(why(dir_ / "link"), HasSubstr("link"));
  EXPECT_THAT(why(dir_ / "no/such"), HasSubstr("No such file"));
  EXPECT_THAT(why(dir_ / std::string(200, 'x')), HasSubstr("too long"));
  if (::geteuid() == 0) {
    ASSERT_EQ(::chmod(folder().c_str(), 0700), 0);
    ASSERT_EQ(::chown(folder().c_str(), 12345, 12345), 0);
    EXPECT_THAT(why(folder()), HasSubstr("another user's"));
  }
}

}  // namespace
}  // namespace porttape
