// `porttape drive`: tapes made here, against a device of this test on a TCP port.
#include <functional>
#include <netinet/in.h>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/sockets.hpp"
#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::StartsWith;

// Serves one connection: what comes and how it is answered is `talk`'s.
class SocketDevice {
 public:
  explicit SocketDevice(std::function<void(int)> talk) : listener_(Socket::listening()) {
    thread_ = std::thread([this, talk = std::move(talk)] {
      pollfd comes{listener_.fd(), POLLIN, 0};
      (void)::poll(&comes, 1, -1);
      const UniqueFd line(::accept(listener_.fd(), nullptr, nullptr));
      if (line) talk(line.get());
    });
  }
  ~SocketDevice() {
    ::shutdown(listener_.fd(), SHUT_RDWR);
    thread_.join();
  }
  SocketDevice(const SocketDevice&) = delete;
  SocketDevice& operator=(const SocketDevice&) = delete;

  [[nodiscard]] std::string port() const { return "tcp:127.0.0.1:" + std::to_string(listener_.port()); }

 private:
  Socket listener_;
  std::thread thread_;
};

std::string read_line(int fd) {
  std::string line;
  for (char c = 0; c != '\n' && ::recv(fd, &c, 1, 0) == 1;) line += c;
  return line;
}
void send_text(int fd, std::string_view text) { (void)::send(fd, text.data(), text.size(), MSG_NOSIGNAL); }
void read_to_the_end(int fd) {
  while (!read_line(fd).empty()) {
  }
}

// Answers "ask\n", and "more\n" by what it says last.
std::function<void(int)> answering(std::string first, std::string last = "rest\n") {
  return [=](int fd) {
    if (read_line(fd) == "ask\n") send_text(fd, first);
    if (read_line(fd) == "more\n") send_text(fd, last);
    read_to_the_end(fd);
  };
}

class DriveVerb : public testing::Test {
 protected:
  DriveVerb()
      : tape(make_tape(dir, "t", {{2000, "42\n"}, {4000, "rest\n"}}, {{1000, "ask\n"}, {3000, "more\n"}})) {}

  Ran drive(const SocketDevice& device, std::vector<std::string> options = {}) const {
    options.insert(options.begin(), {"drive", tape, "--device", device.port()});
    return run(options);
  }

  TempDir dir;
  std::string tape;
};

TEST_F(DriveVerb, PassesWhereTheDeviceAnswersAsRecorded) {
  for (const char* const timing : {"reactive", "recorded", "none"}) {
    const SocketDevice device(answering("42\n"));
    const Ran ran = drive(device, {"--timing", timing, "--report", dir / "report.json"});
    EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
    EXPECT_THAT(ran.out, HasSubstr("from the device 8 of 8 bytes as recorded, to the device 9 of 9"));
    const std::string report(as_text(read_file(dir / "report.json")));
    EXPECT_THAT(report,
                HasSubstr(R"("to_driver":{"bytes":8,"matched":8,"of":8},"from_driver":{"bytes":9,"of":9})"));
    EXPECT_THAT(report, HasSubstr(R"("writer":"device")"));
    EXPECT_THAT(report, HasSubstr(R"("runs":{"count":1,"looks":0,"worst":"pass","list":[{)"));
  }
}

TEST_F(DriveVerb, AnotherAnswerIsADataMismatch) {
  const SocketDevice device(answering("41\n"));
  const Ran ran = drive(device);
  EXPECT_EQ(ran.status, 3) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("\"41\\n\" where the tape has \"42\\n\""));
}

TEST_F(DriveVerb, AnAnswerTooMuchIsExtra) {
  const SocketDevice device(answering("42\n", "rest\nrest\n"));
  const Ran ran = drive(device);
  EXPECT_EQ(ran.status, 3) << ran.err;
  EXPECT_THAT(ran.out, StartsWith("extra: the device sent"));
}

TEST_F(DriveVerb, ASilentDeviceIsIncompleteWithinItsTime) {
  const SocketDevice device(answering("4"));
  const Ran ran = drive(device, {"--timeout", "1", "--report", dir / "report.json"});
  EXPECT_EQ(ran.status, 5) << ran.err;
  EXPECT_THAT(ran.out, StartsWith("incomplete: the device was silent for 1 s\n"));
  EXPECT_THAT(std::string(as_text(read_file(dir / "report.json"))), HasSubstr(R"("exit":5)"));
}

TEST_F(DriveVerb, ADeviceThatHangsUpIsIncomplete) {
  const SocketDevice device([](int fd) {
    read_line(fd);
    ::shutdown(fd, SHUT_RDWR);
  });
  const Ran ran = drive(device);
  EXPECT_EQ(ran.status, 5) << ran.err;
  EXPECT_THAT(ran.out, StartsWith("incomplete: the device ended the line, and the tape goes on\n"));
}

TEST_F(DriveVerb, ADeviceThatIsResetIsLost) {
  const SocketDevice device([](int fd) {
    const linger at_once{1, 0};
    ::setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    read_line(fd);
  });
  const Ran ran = drive(device);
  EXPECT_EQ(ran.status, 6) << ran.out;
  EXPECT_THAT(ran.out, StartsWith("failed: the device was lost"));
}

TEST_F(DriveVerb, OneThatNobodyServesIsMissingAndThereIsAReport) {
  const Socket nobody = Socket::bound();
  const Ran ran = run({"drive", tape, "--device", "tcp:127.0.0.1:" + std::to_string(nobody.port()),
                       "--report", dir / "report.json"});
  EXPECT_EQ(ran.status, 6);
  EXPECT_THAT(std::string(as_text(read_file(dir / "report.json"))), HasSubstr(R"("exit":6)"));
}

TEST_F(DriveVerb, ADeviceThatIsToComeAndDoesNotIsMissing) {
  const Ran ran = run({"drive", tape, "--device", "pty:" + (dir / "line"), "--timeout", "0.05"});
  EXPECT_EQ(ran.status, 6) << ran.out << ran.err;
}

TEST_F(DriveVerb, ADamagedTapeIsARuntimeFailure) {
  Bytes damaged = block_bytes({{2000, "42\n"}});
  damaged.resize(damaged.size() + 100, Byte{0xFF});
  write_file(dir / "t.logr", damaged);
  const SocketDevice device([](int fd) { read_to_the_end(fd); });
  const Ran ran = drive(device);
  EXPECT_EQ(ran.status, 1) << ran.out << ran.err;
}

}  // namespace
}  // namespace porttape::test
