// How a command's run ends on a line that has no pause.
#include "tools/command_run.hpp"

#include <atomic>
#include <cerrno>
#include <chrono>
#include <functional>
#include <poll.h>
#include <signal.h>
#include <string>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/time.hpp"
#include "tests/support/sockets.hpp"
#include "tests/support/time_bound.hpp"
#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;

// A TCP peer that sends as fast as it is read. It makes the file `full` when for a moment nobody reads.
class Flood {
 public:
  explicit Flood(std::string full) : full_(std::move(full)), thread_([this] { send_on(); }) {}
  ~Flood() {
    done_ = true;
    thread_.join();
  }
  Flood(const Flood&) = delete;
  Flood& operator=(const Flood&) = delete;

  [[nodiscard]] std::string place() const { return "tcp:127.0.0.1:" + std::to_string(listening_.port()); }

 private:
  void send_on() {
    while (!done_ && !wait_for(listening_, POLLIN)) {
    }
    if (done_) return;
    const Socket peer = listening_.accept();
    const std::string bytes(65536, 'x');
    while (!done_) {
      if (::send(peer.fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT) >= 0) continue;
      if (errno != EAGAIN) return;
      if (!wait_for(peer, POLLOUT)) write_file(full_, {});
    }
  }
  static bool wait_for(const Socket& socket, short events) {
    pollfd poll{socket.fd(), events, 0};
    return ::poll(&poll, 1, 200) > 0;
  }

  const std::string full_;
  const Socket listening_ = Socket::listening();
  std::atomic<bool> done_ = false;
  std::thread thread_;
};

class CommandRunOnAFlood : public testing::Test {
 protected:
  TempDir dir;
  std::string full = dir / "full";
  Flood device{full};
  const Instant start = machine_clock().now();
  CommandRun command{{.name = "test"}};

  void begin(const std::string& driver) {
    const auto ports = channel_ports(
        {ChannelMode::record, {{"device", device.place()}, {"driver", driver}, {"tape", dir / "t"}}});
    ASSERT_TRUE(ports) << ports.error().message;
    ASSERT_TRUE(command.start_session(*ports));
  }
};

TEST_F(CommandRunOnAFlood, AReaderThatTheCommandLeavesBehindDoesNotKeepItFromItsEnd) {
  const Ran ran = run({"record", "--device", device.place(), "--driver", "tcp-listen:127.0.0.1:0", "--tape",
                       dir / "t", "--", "/bin/bash", "-c",
                       "exec 3<>/dev/tcp/{host}/{tcp_port}; read -r -n 1 first <&3; (cat <&3 >/dev/null; "
                       "sleep 1000) & exit 0"});
  EXPECT_THAT(ran.err, HasSubstr("left running, now ended: "));
  EXPECT_THAT(ran.err, HasSubstr("0 bytes in 0 blocks from the command, "));
  EXPECT_WITHIN(machine_clock().now() - start, seconds(20));
}

// As where one of many lines always has something.
TEST_F(CommandRunOnAFlood, ALoopThatIsNeverIdleDoesNotKeepItFromItsEnd) {
  begin("pty:" + (dir / "line"));
  const std::function<void()> again = [&] {
    if (machine_clock().now() - start < seconds(10)) command.loop().post(again);
  };
  again();
  ASSERT_TRUE(command.run_command({"/bin/true"}));
  command.finish();
  EXPECT_WITHIN(machine_clock().now() - start, seconds(5));
}

// It would be the first stop, and that of finish() the second, which passes nothing on.
TEST_F(CommandRunOnAFlood, ASignalBetweenTheCommandAndTheEndStopsNothing) {
  constexpr std::size_t kMoreThanAnyQueue = 64U << 20;
  begin("tcp-listen:127.0.0.1:0");
  Socket driver = Socket::connect_to(command.channel()->driver().place().port);
  ASSERT_TRUE(command.run_command({"/bin/true"}));
  ::raise(SIGTERM);
  while (driver.got.size() < kMoreThanAnyQueue && driver.ended.empty() &&
         machine_clock().now() - start < seconds(120)) {
    command.loop().poll_one();
    driver.receive();
  }
  EXPECT_GE(driver.got.size(), kMoreThanAnyQueue);
  driver.close();
  command.finish();
}

// Without the signal it waits 5 s for a driver that does not read.
TEST_F(CommandRunOnAFlood, ASignalAfterTheCommandEndsTheLineAtOnce) {
  begin("tcp-listen:127.0.0.1:0");
  const Socket driver = Socket::connect_to(command.channel()->driver().place().port);
  ASSERT_TRUE(command.run_command({"/bin/sh", "-c", "until test -e " + full + "; do sleep 0.02; done"}));
  const Instant end = machine_clock().now();
  std::atomic<bool> finished = false;
  std::thread user([&finished] {
    for (; !finished; std::this_thread::sleep_for(milliseconds(20))) ::kill(::getpid(), SIGTERM);
  });
  command.finish();
  finished = true;
  user.join();
  EXPECT_WITHIN(machine_clock().now() - end, seconds(4));
  EXPECT_EQ(command.interrupted_by(), 0);
}

}  // namespace
}  // namespace porttape::test
