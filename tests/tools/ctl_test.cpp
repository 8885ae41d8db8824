// `porttape ctl` and its connection, with daemons that answer late, wrongly or not at all.

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <poll.h>
#include <sstream>
#include <string>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/support/time_bound.hpp"
#include "tools/control_client.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

using test::TempDir;
using testing::ElementsAre;
using testing::HasSubstr;

UniqueFd listen_at(const std::string& path) {
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const auto address = socket_address(path);
  if (!address || ::bind(fd.get(), reinterpret_cast<const sockaddr*>(&*address), sizeof *address) != 0 ||
      ::listen(fd.get(), 8) != 0)
    fd.reset();
  return fd;
}

// One connection after the other; nothing as a reply: that request gets none.
class FakeDaemon {
 public:
  using Reply = std::function<std::optional<std::string>(const std::string& request)>;

  FakeDaemon(const std::string& folder, Reply reply)
      : listener_(listen_at(control_socket(folder, ::getpid()))),
        reply_(std::move(reply)),
        thread_([this] { serve(); }) {}
  ~FakeDaemon() {
    ::shutdown(listener_.get(), SHUT_RDWR);
    thread_.join();
  }
  FakeDaemon(const FakeDaemon&) = delete;
  FakeDaemon& operator=(const FakeDaemon&) = delete;

 private:
  void serve() {
    for (;;) {
      const UniqueFd client(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
      if (!client) return;
      std::string line;
      for (char c = 0; ::read(client.get(), &c, 1) == 1;) {
        if (c != '\n') {
          line += c;
          continue;
        }
        const auto reply = reply_(line);
        line.clear();
        if (reply) (void)::send(client.get(), (*reply + '\n').data(), reply->size() + 1, MSG_NOSIGNAL);
      }
    }
  }

  UniqueFd listener_;
  Reply reply_;
  std::thread thread_;
};

class CtlTest : public testing::Test {
 protected:
  CtlTest() { ::setenv("RUNTIME_DIRECTORY", dir_.path().c_str(), 1); }
  ~CtlTest() override { ::unsetenv("RUNTIME_DIRECTORY"); }

  int ctl(const std::vector<std::string>& words) {
    std::vector<std::string> args = {"ctl"};
    args.insert(args.end(), words.begin(), words.end());
    std::ostringstream out;
    std::ostringstream err;
    const int status = run_porttape(args, out, err);
    said_ = err.str();
    return status;
  }
  [[nodiscard]] std::string folder() const { return dir_.path().string(); }

  TempDir dir_;
  std::string said_;
};

constexpr const char* kRuns = R"({"ok":true,"status":{"channels":[{"name":"laser","state":"open"}]}})";
constexpr const char* kEnded = R"({"ok":true,"status":{"channels":[{"name":"laser","state":"ended"}]}})";
constexpr const char* kStatus = R"({"verb":"status"})";

TEST_F(CtlTest, WhileOneDoesNotAnswerItIsNotClearWhichIsMeant) {
  // One that listens and does nothing.
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t silent = ::fork();
  if (silent == 0) {
    const UniqueFd fd = listen_at(control_socket(folder(), ::getpid()));
    (void)!::write(ready[1], fd ? "y" : "n", 1);
    for (;;) ::pause();
  }
  char listens = 0;
  ASSERT_EQ(::read(ready[0], &listens, 1), 1);
  ::close(ready[0]);
  ::close(ready[1]);
  EXPECT_EQ(listens, 'y');
  {
    std::vector<std::string> asked;
    const FakeDaemon other(folder(), [&asked](const std::string& request) {
      asked.push_back(request);
      return kRuns;
    });
    EXPECT_EQ(ctl({"stop"}), 2);
    EXPECT_THAT(said_, HasSubstr("process " + std::to_string(silent) + " does not answer"));
    EXPECT_THAT(said_, HasSubstr("-p PID"));
    EXPECT_EQ(ctl({"-c", "laser", "mark", "x"}), 2);
    EXPECT_EQ(ctl({"-p", std::to_string(::getpid()), "mark", "x"}), 0) << said_;
    EXPECT_THAT(asked, ElementsAre(kStatus, kStatus, kStatus, R"({"verb":"mark","text":"x"})"));
  }
  ::kill(silent, SIGKILL);
  ::waitpid(silent, nullptr, 0);
}

// A socket of a process that accepts nothing, with all its places taken.
class FullSocket {
 public:
  explicit FullSocket(const std::string& path) : listener_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const auto address = socket_address(path);
    const auto* const where = reinterpret_cast<const sockaddr*>(&*address);
    EXPECT_EQ(::bind(listener_.get(), where, sizeof *address), 0);
    EXPECT_EQ(::listen(listener_.get(), 0), 0);
    for (;;) {
      UniqueFd client(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
      if (::connect(client.get(), where, sizeof *address) != 0) return;
      clients_.push_back(std::move(client));
    }
  }

 private:
  UniqueFd listener_;
  std::vector<UniqueFd> clients_;
};

TEST_F(CtlTest, ManyThatDoNotAnswerTakeNoLongerThanOne) {
  std::vector<std::unique_ptr<FullSocket>> full;
  for (int n = 0; n < 6; ++n)
    full.push_back(std::make_unique<FullSocket>(control_socket(folder(), 100'000'000 + n)));
  const FakeDaemon daemon(folder(), [](const std::string&) { return kRuns; });
  const Instant begin = std::chrono::steady_clock::now();
  const RunningDaemons running = find_daemons({});
  const auto took = std::chrono::steady_clock::now() - begin;
  ASSERT_EQ(running.daemons.size(), 1U);
  EXPECT_EQ(running.daemons.front().client.pid(), ::getpid());
  ASSERT_EQ(running.silent.size(), full.size());
  for (const Error& silent : running.silent) {
    EXPECT_EQ(silent.code, Errc::io);
    EXPECT_THAT(silent.message, HasSubstr("does not answer within 2 s"));
  }
  EXPECT_GE(took, ControlClient::kLimit) << "each has that time";
  EXPECT_WITHIN(took, std::chrono::seconds(11));
}

TEST_F(CtlTest, WhatGoesWhileItIsAskedIsNotTold) {
  auto full = std::make_unique<FullSocket>(control_socket(folder(), 100'000'000));
  const FakeDaemon daemon(folder(), [&full](const std::string&) {
    full.reset();
    return kRuns;
  });
  const RunningDaemons running = find_daemons({});
  EXPECT_EQ(running.daemons.size(), 1U);
  EXPECT_THAT(running.silent, testing::IsEmpty());
}

TEST_F(CtlTest, AReplyThatIsNoneIsTold) {
  for (const char* const reply : {"nonsense", "[1]", R"({"ok":false,"error":"not now"})"}) {
    const FakeDaemon daemon(folder(), [&](const std::string&) { return reply; });
    const RunningDaemons running = find_daemons({});
    EXPECT_TRUE(running.daemons.empty());
    ASSERT_EQ(running.silent.size(), 1U);
    EXPECT_THAT(running.silent.front().message,
                testing::AnyOf("process " + std::to_string(::getpid()) +
                                   " answers something else than a daemon of porttape",
                               "not now"));
    std::filesystem::remove(control_socket(folder(), ::getpid()));
  }
}

TEST_F(CtlTest, AStatusHasTheProcessThatServesAndNotTheOneThatIsSaid) {
  const FakeDaemon daemon(folder(), [](const std::string&) {
    return R"({"ok":true,"status":{"pid":1,"verb":"record","channels":[]}})";
  });
  const std::vector<std::string> words = {"status", "--json"};
  std::ostringstream out;
  std::ostringstream err;
  EXPECT_EQ(run_porttape(words, out, err), 0) << err.str();
  EXPECT_THAT(out.str(), HasSubstr("\"pid\":" + std::to_string(::getpid())));
}

TEST_F(CtlTest, AnotherUsersDaemonsAreRootsToAsk) {
  EXPECT_EQ(ctl({"--user", "no such user", "stop"}), 2);
  EXPECT_THAT(said_, HasSubstr("--user: there is no user 'no such user'"));
  EXPECT_EQ(ctl({"-p", "x", "stop"}), 2);
  EXPECT_THAT(said_, HasSubstr("--pid is 'x'; it must be the number of a process"));
  if (::geteuid() == 0) {
    EXPECT_EQ(ctl({"stop"}), 1);
    EXPECT_THAT(said_, HasSubstr("no porttaped runs; those of other users are seen with --user NAME"));
  } else {
    EXPECT_EQ(ctl({"--user", "all", "stop"}), 2);
    EXPECT_THAT(said_, HasSubstr("--user: root alone may ask other users' daemons"));
    EXPECT_EQ(ctl({"--user", std::to_string(::geteuid()), "stop"}), 1);
  }
}

TEST_F(CtlTest, AWrongRequestIsUsageAndWhatCouldNotBeDoneIsNot) {
  std::string reply;
  const FakeDaemon daemon(folder(), [&reply](const std::string& request) {
    return request == kStatus ? std::string(kRuns) : reply;
  });
  reply = R"({"ok":false,"kind":"usage","error":"the text has 5000 bytes"})";
  EXPECT_EQ(ctl({"mark", "x"}), 2);
  EXPECT_THAT(said_, HasSubstr("the text has 5000 bytes"));
  reply = R"({"ok":false,"error":"no driver yet"})";
  EXPECT_EQ(ctl({"mark", "x"}), 1);
  EXPECT_THAT(said_, HasSubstr("no driver yet"));
}

TEST_F(CtlTest, AChannelsEndIsSeenAlsoAfterAReplyThatDidNotCome) {
  bool stopped = false;
  bool stalled = false;
  const FakeDaemon daemon(folder(), [&](const std::string& request) -> std::optional<std::string> {
    if (request != kStatus) {
      stopped = true;
      return R"({"ok":true,"channels":["laser"],"refused":[]})";
    }
    if (!stopped) return kRuns;
    if (!std::exchange(stalled, true)) return std::nullopt;
    return kEnded;
  });
  const Instant begin = std::chrono::steady_clock::now();
  EXPECT_EQ(ctl({"-c", "laser", "stop"}), 0) << said_;  // the daemon runs on
  EXPECT_TRUE(stalled);
  EXPECT_WITHIN(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
}

TEST_F(CtlTest, InAUsersFolderTheProcessOfTheNameMustBeItsDaemon) {
  const std::string path = control_socket(folder(), ::getpid());
  const UniqueFd listener = listen_at(path);
  const uid_t self = ::geteuid() == 0 ? 12345 : ::geteuid();  // root may serve in a user's folder
  const auto connected = [&](pid_t pid, uid_t owner) {
    const auto client = ControlClient::connect({path, pid, owner});
    if (!client) {
      EXPECT_EQ(client.error().code, Errc::usage);
    }
    return client && *client;
  };
  EXPECT_TRUE(connected(::getpid(), self));
  EXPECT_FALSE(connected(::getpid() + 1, self));
  EXPECT_TRUE(connected(::getpid() + 1, 0));
  if (::geteuid() != 0) {
    EXPECT_FALSE(connected(::getpid(), self + 1));
  }
}

TEST_F(CtlTest, AStaleSocketIsRemovedInAFolderOfItsUserAlone) {
  const std::string path = control_socket(folder(), ::getpid());
  const auto gone = [&] {
    const auto client = ControlClient::connect({path, ::getpid(), ::geteuid()});
    EXPECT_TRUE(client && !*client);
    return !std::filesystem::exists(std::filesystem::symlink_status(path));
  };
  (void)listen_at(path);  // nobody has it any more
  EXPECT_TRUE(gone());
  if (::geteuid() == 0) {
    (void)listen_at(path);
    ASSERT_EQ(::chown(folder().c_str(), 12345, 12345), 0);
    EXPECT_FALSE(gone());
  }
}

}  // namespace
}  // namespace porttape
