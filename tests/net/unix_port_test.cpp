#include "libport/net/unix_port.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/sockets.hpp"
#include "tests/support/temp_dir.hpp"

namespace {

std::function<void()> after_bind;  // what somebody else does just then

}  // namespace

// In the place of the C library's, for this program.
// NOLINTNEXTLINE(readability-inconsistent-declaration-parameter-name)
extern "C" int bind(int fd, const sockaddr* address, socklen_t size) noexcept {
  const auto result = static_cast<int>(::syscall(SYS_bind, fd, address, size));
  if (after_bind) std::exchange(after_bind, {})();
  return result;
}

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::Socket;

class UnixPortTest : public testing::Test {
 protected:
  Result<void> make(const std::string& more) {
    const Result<PortSpec> spec = parse_port("unix:" + path + more);
    if (!spec) return spec.error();
    port.emplace(PortContext{&loop, book.log()}, spec->common(), *spec->get<UnixOptions>());
    port->listen(log);
    return port->prepare();
  }
  [[nodiscard]] Socket connect() const { return Socket::connect_to(*unix_address(path)); }

  test::TempDir dir;
  std::string path = dir / "socket";
  Loop loop;
  LogBook book;
  PortLog log;
  std::optional<UnixPort> port;
};

TEST_F(UnixPortTest, TheSocketIsPrivateAndGoesAwayAtTheEnd) {
  ASSERT_TRUE(make(",listen").has_value());
  struct stat status {};
  ASSERT_EQ(::lstat(path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  port.reset();
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(UnixPortTest, TheSocketGoesAwayThoughNoDescriptorIsLeft) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  ASSERT_TRUE(make(",listen"));
  const test::NoDescriptors none(unsanitized);
  port.reset();
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(UnixPortTest, AConnectionThatIsAPortOfItsOwnHasTheSocketsName) {
  ASSERT_TRUE(make(",listen").has_value());
  std::unique_ptr<Port> given;
  port->connections()->give_each(
      [&](std::unique_ptr<Port> connection, const std::string&) { given = std::move(connection); });
  port->open();
  const Socket peer = connect();
  run_until(loop, [&] { return given != nullptr; });
  EXPECT_EQ(given->place().path, path);
  EXPECT_FALSE(given->passive());
  given.reset();
  EXPECT_TRUE(fs::exists(path)) << "the socket is the listening port's";
}

TEST_F(UnixPortTest, TheModeCanBeChosen) {
  ASSERT_TRUE(make(",listen,mode=0666").has_value());
  struct stat status {};
  ASSERT_EQ(::lstat(path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0666U);
  port.reset();
  EXPECT_FALSE(make(",listen,mode=rw").has_value());
  EXPECT_FALSE(make(",listen,mode=01777").has_value());
}

TEST_F(UnixPortTest, TheUmaskTakesNothingFromTheMode) {
  const mode_t old = ::umask(0077);
  ASSERT_TRUE(make(",listen,mode=0666").has_value());
  ::umask(old);
  struct stat status {};
  ASSERT_EQ(::lstat(path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0666U);
}

TEST_F(UnixPortTest, ALinkPlantedAsTheSocketIsMadeIsNotFollowed) {
  const std::string precious = dir / "precious";
  std::ofstream(precious) << "data";
  ASSERT_EQ(::chmod(precious.c_str(), 0600), 0);
  after_bind = [&] {
    fs::remove(path);
    fs::create_symlink(precious, path);
  };
  const Result<void> made = make(",listen,mode=0666");
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, Errc::usage);
  EXPECT_EQ(made.error().message, "socket '" + path +
                                      "' was replaced as it was made; choose a folder that nobody else "
                                      "writes to");
  struct stat status {};
  ASSERT_EQ(::lstat(precious.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  port.reset();
  EXPECT_TRUE(fs::is_symlink(path)) << "somebody else's is left alone";
}

TEST_F(UnixPortTest, NoOtherUsersLinkLeadsToTheSocket) {
  const std::string folder = dir / "folder";
  const std::string link = dir / "link";
  fs::create_directory(folder);
  fs::create_symlink(folder, link);
  path = link + "/socket";
  ASSERT_TRUE(make(",listen").has_value()) << "our own link";
  port.reset();
  EXPECT_FALSE(fs::exists(folder + "/socket"));
  if (::lchown(link.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "needs root, to give a link away";
  const Result<void> made = make(",listen");
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, Errc::usage);
  EXPECT_FALSE(fs::exists(folder + "/socket"));
}

TEST_F(UnixPortTest, BytesGoBothWays) {
  ASSERT_TRUE(make(",listen").has_value());
  port->open();
  Socket peer = connect();
  peer.send("ask");
  run_until(loop, [&] { return log.data == "ask"; });
  port->write(as_bytes("answer"));
  peer.receive();
  EXPECT_EQ(peer.got, "answer");
  peer.close();
  run_until(loop, [&] { return log.events == "up closed "; });
}

TEST_F(UnixPortTest, AFileIsNeverReplaced) {
  std::ofstream(path) << "data";
  const Result<void> made = make(",listen");
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, Errc::usage);
  EXPECT_EQ(made.error().message,
            "socket '" + path + "' exists and is not a socket; it is left alone, choose another path");
  EXPECT_EQ(fs::file_size(path), 4U);
}

TEST_F(UnixPortTest, ASocketInUseIsNotReplacedAStaleOneIs) {
  {
    const SocketAddress address = *unix_address(path);
    const UniqueFd other(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(::bind(other.get(), address.get(), address.size), 0);
    ASSERT_EQ(::listen(other.get(), 1), 0);
    const Result<void> made = make(",listen");
    ASSERT_FALSE(made.has_value());
    EXPECT_EQ(made.error().code, Errc::usage);
    EXPECT_EQ(made.error().message,
              "socket '" + path + "' is in use; end that program or choose another path");
  }
  EXPECT_TRUE(make(",listen").has_value());
}

TEST_F(UnixPortTest, ASocketThatSomebodyElsePutThereStays) {
  ASSERT_TRUE(make(",listen").has_value());
  fs::remove(path);
  std::ofstream(path) << "other";
  port.reset();
  EXPECT_TRUE(fs::exists(path));
}

TEST_F(UnixPortTest, AMissingSocketIsAMissingDeviceUnlessItIsWaitedFor) {
  const Result<void> made = make("");
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, Errc::device_missing);
  EXPECT_EQ(made.error().message, "socket '" + path +
                                      "': No such file or directory; is the program that listens there "
                                      "running?");
  EXPECT_TRUE(make(",wait").has_value());
}

TEST_F(UnixPortTest, AFileInThePlaceOfTheDevicesSocketIsNoDevice) {
  std::ofstream(path) << "data";
  const Result<void> made = make("");
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, Errc::device_missing);
  EXPECT_EQ(made.error().message, "socket '" + path + "': it is not a socket");
}

TEST_F(UnixPortTest, AMissingFolderIsAUsageErrorThatSaysHowToMakeIt) {
  path = dir / "folder/socket";
  const Result<void> made = make(",listen");
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, Errc::usage);
  EXPECT_EQ(
      made.error().message,
      "socket '" + path + "' cannot be made: No such file or directory; type mkdir -p " + (dir / "folder"));
}

TEST_F(UnixPortTest, WhereItListensIsTold) {
  ASSERT_TRUE(make(",listen").has_value());
  EXPECT_NE(book.text().find("listening on " + path), std::string::npos) << book.text();
}

TEST_F(UnixPortTest, ConnectsToAListener) {
  const SocketAddress address = *unix_address(path);
  const Socket server(UniqueFd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)));
  ASSERT_EQ(::bind(server.fd(), address.get(), address.size), 0);
  ASSERT_EQ(::listen(server.fd(), 1), 0);
  ASSERT_TRUE(make("").has_value());
  port->open();
  run_until(loop, [&] { return log.events == "up "; });
  Socket peer = server.accept();
  port->write(as_bytes("hello"));
  peer.receive();
  EXPECT_EQ(peer.got, "hello");
}

// A socket that cannot be made is told with its path and the reason, and leaves no file.
TEST_F(UnixPortTest, ACallThatFailsIsToldAndLeavesNothing) {
  const std::pair<std::vector<test::RefusedCall>, std::string> cases[] = {
      {{{SYS_socket, EMFILE}}, "Too many open files"},
      {{{SYS_socket, ENOBUFS}}, "No buffer space available"},
      {{{SYS_fchmod, EPERM}}, "Operation not permitted"},
      {{{SYS_bind, EACCES}}, "Permission denied"},
      {{{SYS_bind, EROFS}}, "Read-only file system"},
      {{{SYS_bind, ENOSPC}}, "No space left on device"},
      {{{SYS_bind, ENOENT}}, "No such file or directory; type mkdir -p " + dir.path().string()},
      {{{SYS_listen, EADDRINUSE}}, "Address already in use"}};
  for (const auto& [calls, why] : cases) {
    EXPECT_TRUE(test::while_refused(calls, [&, why = why] {
      const Result<void> made = make(",listen");
      ASSERT_FALSE(made.has_value()) << why;
      EXPECT_EQ(made.error(), make_error(Errc::usage, "socket '" + path + "' cannot be made: " + why));
    }));
    port.reset();
    EXPECT_FALSE(fs::exists(path)) << why;
    EXPECT_EQ(book.text(), "") << "it does not listen";
  }
}

// Runs `work` in a thread in which these calls are refused as soon as bind() has made the file.
testing::AssertionResult while_refused_after_bind(const std::vector<test::RefusedCall>& calls,
                                                  const std::function<void()>& work) {
  bool refused = false;
  std::thread([&] {
    after_bind = [&] { refused = test::refuse(calls); };
    work();
  }).join();
  return refused ? testing::AssertionSuccess()
                 : testing::AssertionFailure() << "the system calls cannot be refused";
}

TEST_F(UnixPortTest, AFileThatCannotBeLookedAtIsLeftForTheNextListener) {
  const std::vector<test::RefusedCall> cases[] = {
      {test::refused_open(O_PATH | O_NOFOLLOW, EMFILE)},
      {test::refused_open(O_PATH | O_NOFOLLOW, EACCES)},
      {{SYS_fstat, EIO},
       {SYS_newfstatat, EIO, test::RefusedCall::Argument{3, AT_EMPTY_PATH, AT_EMPTY_PATH}}}};
  for (const auto& calls : cases) {
    EXPECT_TRUE(while_refused_after_bind(calls, [&] {
      const Result<void> made = make(",listen");
      ASSERT_FALSE(made.has_value());
      EXPECT_EQ(made.error().message.find("socket '" + path + "' cannot be made: "), 0U);
    }));
    port.reset();
    EXPECT_TRUE(fs::exists(path)) << "whose it is was not known";
    ASSERT_TRUE(make(",listen").has_value());
    port.reset();
    EXPECT_FALSE(fs::exists(path));
  }
}

TEST_F(UnixPortTest, WhatIsNoSocketOfOurOwnByThenWasReplaced) {
  const std::string replaced =
      "socket '" + path + "' was replaced as it was made; choose a folder that nobody else writes to";
  for (const int error : {ENOENT, ELOOP}) {
    EXPECT_TRUE(while_refused_after_bind({test::refused_open(O_PATH | O_NOFOLLOW, error)}, [&] {
      const Result<void> made = make(",listen");
      ASSERT_FALSE(made.has_value());
      EXPECT_EQ(made.error(), make_error(Errc::usage, replaced));
    }));
    port.reset();
    fs::remove(path);
  }
  after_bind = [&] {
    fs::remove(path);
    std::ofstream(path) << "theirs";
  };
  EXPECT_EQ(make(",listen").error(), make_error(Errc::usage, replaced));
  port.reset();
  EXPECT_EQ(fs::file_size(path), 6U);
  fs::remove(path);
  bool given_away = false;
  after_bind = [&] { given_away = ::chown(path.c_str(), 12345, 12345) == 0; };  // as root
  const Result<void> made = make(",listen");
  if (given_away) {
    ASSERT_FALSE(made.has_value());
    EXPECT_EQ(made.error(), make_error(Errc::usage, replaced)) << "another user's";
  }
}

#ifdef SYS_chmod
TEST_F(UnixPortTest, PermissionsThatTheUmaskTookAndThatCannotBeGivenBackAreTold) {
  const mode_t old = ::umask(0077);
  EXPECT_TRUE(
      test::while_refused({{SYS_chmod, EPERM}}, [&] { EXPECT_TRUE(make(",listen,mode=0666").has_value()); }));
  ::umask(old);
  EXPECT_NE(book.text().find("socket '" + path +
                             "' has the permissions 0600, not 0666: Operation not "
                             "permitted"),
            std::string::npos)
      << book.text();
}
#endif

TEST_F(UnixPortTest, OnlyASocketThatRefusesIsStale) {
  for (const int error : {ECONNREFUSED, EPROTOTYPE, EACCES, EAGAIN, EPERM}) {
    {
      const SocketAddress address = *unix_address(path);
      const UniqueFd other(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
      ASSERT_EQ(::bind(other.get(), address.get(), address.size), 0);
    }
    EXPECT_TRUE(test::while_refused({{SYS_connect, error}}, [&] {
      const Result<void> made = make(",listen");
      EXPECT_EQ(made.has_value(), error == ECONNREFUSED) << error;
      if (!made) {
        EXPECT_EQ(made.error().message,
                  "socket '" + path + "' is in use; end that program or choose another path");
      }
    }));
    port.reset();
    EXPECT_EQ(fs::exists(path), error != ECONNREFUSED);
    fs::remove(path);
  }
}

TEST_F(UnixPortTest, ASocketThatCannotBeAskedIsNotSaidToBeInUse) {
  {
    const SocketAddress address = *unix_address(path);
    const UniqueFd other(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(::bind(other.get(), address.get(), address.size), 0);
  }
  EXPECT_TRUE(test::while_refused({{SYS_socket, EMFILE}}, [&] {
    const Result<void> made = make(",listen");
    ASSERT_FALSE(made.has_value());
    EXPECT_EQ(made.error(),
              make_error(Errc::usage, "socket '" + path + "' cannot be made: Too many open files"));
  }));
  EXPECT_TRUE(fs::exists(path));
}

TEST_F(UnixPortTest, ADevicesSocketThatCannotBeLookedAtIsMissingWithTheReason) {
  EXPECT_TRUE(test::while_refused({{SYS_newfstatat, EACCES}}, [&] {
    const Result<void> made = make("");
    ASSERT_FALSE(made.has_value());
    EXPECT_EQ(made.error(),
              make_error(Errc::device_missing, "socket '" + path +
                                                   "': Permission denied; is the program that listens "
                                                   "there running?"));
  }));
}

}  // namespace
}  // namespace porttape
