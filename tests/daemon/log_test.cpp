#include "daemon/log.hpp"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <poll.h>
#include <sstream>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "daemon/log_target.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/net/socket_address.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using Protocol = SocketTarget::Protocol;

std::string text_of(const std::string& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

// A datagram socket at a path, as the journal and syslog have.
class Collector {
 public:
  explicit Collector(const std::string& path) : fd_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const SocketAddress address = *unix_address(path);
    EXPECT_EQ(::bind(fd_.get(), address.get(), address.size), 0);
  }
  [[nodiscard]] std::string receive() const {
    std::array<char, 4096> buffer{};
    const ssize_t size = ::recv(fd_.get(), buffer.data(), buffer.size(), 0);
    return {buffer.data(), size > 0 ? static_cast<std::size_t>(size) : 0};
  }

 private:
  UniqueFd fd_;
};

TEST(Log, AFileIsAddedToAndOpenedAgain) {
  const test::TempDir dir;
  const std::string path = dir / "log";
  std::ofstream(path) << "old\n";
  {
    const Result<Log> log = make_log({.file = path}, spdlog::level::info);
    ASSERT_TRUE(log.has_value()) << log.error().message;
    log->logger->info("one");
    std::filesystem::rename(path, dir / "moved");
    log->reopen();
    log->logger->info("two");
  }
  EXPECT_THAT(text_of(dir / "moved") + text_of(path), HasSubstr("old\n"));
  EXPECT_THAT(text_of(path), EndsWith("two\n"));
}

TEST(Log, AFileThatCannotBeWrittenIsAUsageError) {
  const test::TempDir dir;
  const Result<Log> log = make_log({.file = dir / "none/log"}, spdlog::level::info);
  ASSERT_FALSE(log.has_value());
  EXPECT_EQ(log.error().code, Errc::usage);
  EXPECT_THAT(log.error().message, HasSubstr("none/log"));
}

TEST(Log, ALinkOfOnesOwnIsFollowed) {
  const test::TempDir dir;
  std::filesystem::create_symlink("real", dir / "log");
  {
    const Result<Log> log = make_log({.file = dir / "log"}, spdlog::level::info);
    ASSERT_TRUE(log.has_value()) << log.error().message;
    log->logger->info("one");
  }
  EXPECT_THAT(text_of(dir / "real"), EndsWith("one\n"));
  EXPECT_TRUE(std::filesystem::is_symlink(dir / "log"));
}

class LogBehindALinkOfAnotherUser : public testing::Test {
 protected:
  void SetUp() override {
    std::ofstream(dir / "mine").flush();
    if (::chown((dir / "mine").c_str(), 12345, 12345) != 0)
      GTEST_SKIP() << "only root can make a link of another user";
  }
  void make_link() const {
    std::filesystem::create_symlink("victim", path);
    ASSERT_EQ(::lchown(path.c_str(), 12345, 12345), 0);
  }
  test::TempDir dir;
  const std::string path = dir / "log";
};

TEST_F(LogBehindALinkOfAnotherUser, IsNeitherMadeNorAddedTo) {
  make_link();
  const Result<Log> log = make_log({.file = path}, spdlog::level::info);
  ASSERT_FALSE(log.has_value());
  EXPECT_EQ(log.error().code, Errc::usage);
  EXPECT_THAT(log.error().message, HasSubstr("log' is a link that another user made"));
  EXPECT_FALSE(std::filesystem::exists(dir / "victim"));
}

TEST_F(LogBehindALinkOfAnotherUser, IsNotOpenedAgainEither) {
  {
    const Result<Log> log = make_log({.file = path}, spdlog::level::info);
    ASSERT_TRUE(log.has_value()) << log.error().message;
    std::filesystem::rename(path, dir / "moved");
    make_link();
    log->reopen();
    log->logger->info("two");
  }
  EXPECT_FALSE(std::filesystem::exists(dir / "victim"));
  EXPECT_THAT(text_of(dir / "moved"), EndsWith("two\n")) << "the old one stays";
}

TEST_F(LogBehindALinkOfAnotherUser, IsNotMadeInAFolderBehindItEither) {
  std::filesystem::create_directory(dir / "victim");
  make_link();
  const Result<Log> log = make_log({.file = path + "/x"}, spdlog::level::info);
  ASSERT_FALSE(log.has_value());
  EXPECT_EQ(log.error().code, Errc::usage);
  EXPECT_THAT(log.error().message, HasSubstr("'log' on the way there is a link that another user made"));
  EXPECT_TRUE(std::filesystem::is_empty(dir / "victim"));
}

TEST(Log, APipeThatNobodyReadsIsNoWait) {
  const test::TempDir dir;
  const std::string path = dir / "pipe";
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  const Result<Log> log = make_log({.file = path}, spdlog::level::info);
  ASSERT_TRUE(log.has_value()) << log.error().message;
  for (int n = 0; n < 2000; ++n) log->logger->info("{}", std::string(200, 'x'));
}

TEST(Log, InTheBackgroundItGoesToTheJournalElseToSyslog) {
  const test::TempDir dir;
  const LogPlace place{.file = {}, .background = true, .journal = dir / "journal", .syslog = dir / "syslog"};
  const Collector syslog(place.syslog);
  {
    const Result<Log> log = make_log(place, spdlog::level::info);
    ASSERT_TRUE(log.has_value());
    EXPECT_EQ(log->place, "syslog");
    log->logger->error("trouble");
  }
  EXPECT_THAT(syslog.receive(), HasSubstr("porttaped: trouble"));
  const Collector journal(place.journal);
  {
    const Result<Log> log = make_log(place, spdlog::level::info);
    ASSERT_TRUE(log.has_value());
    EXPECT_EQ(log->place, "the journal");
    log->logger->error("trouble");
  }
  EXPECT_EQ(journal.receive(), "PRIORITY=3\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=porttaped: trouble\n");
}

TEST(Log, InTheBackgroundWithoutEitherItIsAFileOfTheState) {
  const test::TempDir dir;
  ::setenv("XDG_STATE_HOME", dir.path().c_str(), 1);
  const Result<Log> log = make_log(
      {.file = {}, .background = true, .journal = dir / "none", .syslog = dir / "none"}, spdlog::level::info);
  ::unsetenv("XDG_STATE_HOME");
  ASSERT_TRUE(log.has_value()) << log.error().message;
  EXPECT_EQ(log->place, dir / "porttape/" + std::to_string(::getpid()) + ".log");
  EXPECT_TRUE(std::filesystem::exists(log->place));
}

TEST(Log, MessagesHaveThePriorityOfTheLine) {
  EXPECT_EQ(as_message(Protocol::syslog, "<3>bad"), "<27>porttaped[" + std::to_string(::getpid()) + "]: bad");
  EXPECT_EQ(as_message(Protocol::journal, "plain"),
            "PRIORITY=6\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=plain\n");
  EXPECT_EQ(as_message(Protocol::journal, "<4>"), "PRIORITY=4\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=\n");
  for (const std::string line : {"<4", "<", "", "x4>", "<4)"}) {
    EXPECT_EQ(as_message(Protocol::journal, line),
              "PRIORITY=6\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=" + line + "\n");
  }
}

TEST(Log, ASocketTakesOneLineAMessageAndTellsWhetherAllWereTaken) {
  const test::TempDir dir;
  const std::string path = dir / "journal";
  auto journal = std::make_unique<Collector>(path);
  const auto target = SocketTarget::connect(path, Protocol::journal);
  ASSERT_NE(target, nullptr);
  EXPECT_TRUE(target->write("<3>one\n<3>two"));
  EXPECT_EQ(journal->receive(), "PRIORITY=3\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=one\n");
  EXPECT_EQ(journal->receive(), "PRIORITY=3\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=two\n");
  const std::string too_long(std::size_t{4} << 20, 'x');
  EXPECT_FALSE(target->write(too_long + "\nthree\n")) << "what comes behind a lost line";
  EXPECT_EQ(journal->receive(), "PRIORITY=6\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=three\n");
  EXPECT_FALSE(target->write("four\n" + too_long + "\n"));
  EXPECT_EQ(journal->receive(), "PRIORITY=6\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=four\n");
  journal.reset();
  std::filesystem::remove(path);
  EXPECT_FALSE(target->write("five\n"));
  const Collector again(path);
  EXPECT_TRUE(target->write("six\n")) << "the one who listens was started again";
  EXPECT_EQ(again.receive(), "PRIORITY=6\nSYSLOG_IDENTIFIER=porttaped\nMESSAGE=six\n");
}

TEST(Log, AFileThatTakesNoMoreIsToldSo) {
  const test::TempDir dir;
  const std::string full = "/dev/full";
  const Result<std::unique_ptr<LogTarget>> target = FileTarget::open(full);
  ASSERT_TRUE(target.has_value()) << target.error().message;
  EXPECT_FALSE((*target)->write("one\n"));
}

TEST(Log, AWriteThatTakesNothingOrFailsIsToldAndTheNextOneIsTriedAllTheSame) {
  const test::TempDir dir;
  const std::string path = dir / "log";
  const Result<std::unique_ptr<LogTarget>> target = FileTarget::open(path);
  ASSERT_TRUE(target.has_value()) << target.error().message;
  int fd = -1;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    if (std::filesystem::read_symlink(entry.path(), gone) == path) fd = std::stoi(entry.path().filename());
  }
  ASSERT_GE(fd, 0);
  for (const int error : {0, EIO, ENOSPC}) {
    EXPECT_TRUE(test::while_refused({test::refused_on(fd, SYS_write, error)},
                                    [&] { EXPECT_FALSE((*target)->write("lost\n")) << error; }));
  }
  EXPECT_TRUE((*target)->write("kept\n"));
  EXPECT_EQ(text_of(path), "kept\n");
}

}  // namespace
}  // namespace porttape
