// `porttape record`: a shell command on a device that is a pty of this test.
#include <array>
#include <atomic>
#include <fcntl.h>
#include <filesystem>
#include <memory>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string>
#include <termios.h>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tests/support/sockets.hpp"
#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;
using testing::Not;

// A tty that answers each line: "ask\n" with "42\n".
class PtyDevice {
 public:
  PtyDevice() : master_(::posix_openpt(O_RDWR | O_NOCTTY)) {
    ::grantpt(master_.get());
    ::unlockpt(master_.get());
    path_ = ::ptsname(master_.get());
    slave_.reset(::open(path_.c_str(), O_RDWR | O_NOCTTY));
    termios raw{};
    ::tcgetattr(slave_.get(), &raw);
    ::cfmakeraw(&raw);
    ::tcsetattr(slave_.get(), TCSANOW, &raw);
    thread_ = std::thread([this] { answer(); });
  }
  ~PtyDevice() {
    done_ = true;
    thread_.join();
  }
  PtyDevice(const PtyDevice&) = delete;
  PtyDevice& operator=(const PtyDevice&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  void answer() {
    while (!done_) {
      pollfd poll{master_.get(), POLLIN, 0};
      if (::poll(&poll, 1, 20) <= 0) continue;
      std::array<char, 64> text{};
      const ssize_t size = ::read(master_.get(), text.data(), text.size());
      if (size > 0 && text.at(static_cast<std::size_t>(size - 1)) == '\n')
        (void)!::write(master_.get(), "42\n", 3);
    }
  }

  UniqueFd master_;
  UniqueFd slave_;
  std::string path_;
  std::atomic<bool> done_ = false;
  std::thread thread_;
};

class RecordVerb : public testing::Test {
 protected:
  Ran record(const std::string& command, std::vector<std::string> options = {}) const {
    options.insert(options.begin(), {"record", "--device", device.path(), "--tape", tape});
    options.insert(options.end(), {"--", "/bin/bash", "-c", command});
    return run(options);
  }
  [[nodiscard]] bool there(const std::string& file) const { return std::filesystem::exists(file); }
  [[nodiscard]] TapeSummary recorded() const {
    const Result<TapeSummary> found = summarize(literal_tape(tape + ".log"));
    return found ? *found : TapeSummary{};
  }

  PtyDevice device;
  TempDir dir;
  std::string tape = dir / "t";
  const std::string good = "exec 3<>{port}; echo ask >&3; read answer <&3; test \"$answer\" = 42";
};

TEST_F(RecordVerb, OneCommandGivesATapeAndSaysWhatIsOnIt) {
  const Ran ran = record(good);
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(ran.out, "");
  EXPECT_THAT(ran.err, HasSubstr(tape + ".log: 1 exchange in "));
  EXPECT_THAT(ran.err, HasSubstr("4 bytes in 1 block from the command, 3 bytes in 1 block from the device"));
  EXPECT_THAT(ran.err, HasSubstr("  look at it    porttape cat " + tape + ".log\n"));
  EXPECT_THAT(ran.err, HasSubstr("  test with it  porttape test --tape " + tape + ".log -- /bin/bash -c '"));
  EXPECT_EQ(run({"verify", tape}).status, 0);
  EXPECT_EQ(run({"test", "--tape", tape, "--", "/bin/bash", "-c", good}).status, 0);
}

TEST_F(RecordVerb, TheEnvironmentHasThePortToo) {
  ::setenv("PORTTAPE_HOST", "of another one, outside", 1);
  const Ran ran =
      record("exec 3<>\"$PORTTAPE_PORT\"; echo ask >&3; read answer <&3; test -z \"${PORTTAPE_HOST+set}\"");
  ::unsetenv("PORTTAPE_HOST");
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(recorded().write.bytes, 4U);
}

TEST_F(RecordVerb, EndsAsItsCommandDid) {
  EXPECT_EQ(record(good + "; exit 7").status, 7);
  EXPECT_TRUE(recorded().events.ended);
  tape = dir / "killed";
  const Ran ran = record(good + "; kill -SEGV $$");
  EXPECT_EQ(ran.status, 128 + SIGSEGV);
  EXPECT_THAT(ran.err, HasSubstr("the command was ended by SIGSEGV (11)"));
  EXPECT_TRUE(recorded().events.ended);
}

TEST_F(RecordVerb, AnInterruptGoesToTheCommandAndTheTapeIsWhole) {
  const Ran ran = record("trap 'exit 9' INT; " + good + "; kill -INT $PPID; while :; do sleep 0.05; done");
  EXPECT_EQ(ran.status, 9) << ran.err;
  EXPECT_TRUE(recorded().events.ended);
  EXPECT_EQ(recorded().read.bytes, 3U);
}

TEST_F(RecordVerb, ASecondInterruptKillsTheCommand) {
  const Ran ran =
      record("trap 'kill -INT $PPID' INT; " + good + "; kill -INT $PPID; while :; do sleep 0.05; done");
  EXPECT_EQ(ran.status, 128 + SIGKILL) << ran.err;
  EXPECT_TRUE(recorded().events.ended);
}

TEST_F(RecordVerb, WhatTheCommandLeftRunningIsEndedAndNamed) {
  const Ran ran = record(good + "; sleep 1000 & exit 0");
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("left running, now ended: "));
}

TEST_F(RecordVerb, ATapesNameIsCheckedBeforeTheCommandStarts) {
  write_file(tape + ".logr", bytes_of("mine"));
  const std::string ran_mark = dir / "ran";
  for (const std::string& name : {tape, dir / "no/such/folder"}) {
    const Ran ran = run({"record", "--device", device.path(), "--tape", name, "--", "/bin/touch", ran_mark});
    EXPECT_EQ(ran.status, 2) << ran.err;
  }
  EXPECT_FALSE(there(ran_mark));
  EXPECT_EQ(read_file(tape + ".logr"), bytes_of("mine"));
}

TEST_F(RecordVerb, TheNextFreeNameIsTold) {
  EXPECT_EQ(record(good).status, 0);
  const Ran ran = record(good, {"--on-existing", "next"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("porttape cat " + tape + ".2.log\n"));
  EXPECT_TRUE(there(tape + ".2.logr"));
}

TEST_F(RecordVerb, EachTapeOfARotationIsTold) {
  const Ran ran = record(good + "; kill -USR1 $PPID; until test -e " + tape +
                         ".2.logr; do sleep 0.02; done; " + "echo ask >&3; read answer <&3");
  EXPECT_EQ(ran.status, 0) << ran.err;
  for (const char* name : {".log", ".2.log"})
    EXPECT_THAT(ran.err, HasSubstr(tape + name + ": 1 exchange in "));
}

TEST_F(RecordVerb, AMissingDeviceIsSixAndNoCommand) {
  const std::string ran_mark = dir / "ran";
  const Ran ran =
      run({"record", "--device", "serial:" + dir / "none", "--tape", tape, "--", "/bin/touch", ran_mark});
  EXPECT_EQ(ran.status, 6) << ran.err;
  EXPECT_FALSE(there(ran_mark));
}

TEST_F(RecordVerb, ADeviceThatIsNotThereWhenThePortIsOpenedIsSix) {
  const Socket refusing = Socket::bound();
  const Ran ran = run({"record", "--device", "tcp:127.0.0.1:" + std::to_string(refusing.port()), "--tape",
                       tape, "--", "/bin/bash", "-c", "exec 3<>{port}; cat <&3 >/dev/null; exit 0"});
  EXPECT_EQ(ran.status, 6) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("porttape record: "));
}

TEST_F(RecordVerb, ADeviceThatHasGoneWhenAConnectionComesIsSix) {
  const std::string path = dir / "device";
  const SocketAddress address = *unix_address(path);
  const UniqueFd bound(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  ASSERT_EQ(::bind(bound.get(), address.get(), address.size), 0);
  const Ran ran = run({"record", "--device", "unix:" + path, "--driver", "tcp-listen:127.0.0.1:0",
                       "--connections", "each", "--tape", tape, "--", "/bin/bash", "-c",
                       "rm " + path + "; exec 3<>/dev/tcp/{host}/{tcp_port}; cat <&3; exit 0"});
  EXPECT_EQ(ran.status, 6) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("there is no tape; what went wrong is told above"));
}

TEST_F(RecordVerb, ACommandThatCannotBeRunIsTwoAndNoTape) {
  const auto with = [this](const std::string& program) {
    return run({"record", "--device", device.path(), "--tape", tape, "--", program, "{port}"});
  };
  EXPECT_EQ(with("/no/such/program").status, 2);
  EXPECT_THAT(with("python3 x.py {port}").err, HasSubstr("without quotes"));
  const std::string script = dir / "script";
  write_file(script, bytes_of("echo"));
  const Ran ran = with(script);
  EXPECT_EQ(ran.status, 2);
  EXPECT_THAT(ran.err, HasSubstr("chmod +x"));
  EXPECT_FALSE(there(tape + ".logr"));
}

TEST_F(RecordVerb, ACommandThatNeverOpensItsPortIsNoSilentSuccess) {
  const Ran ran = record("true");
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.err, HasSubstr("never opened its port, so that there is no tape"));
  EXPECT_THAT(ran.err, HasSubstr("write {port} in COMMAND"));
  EXPECT_FALSE(there(tape + ".logr"));
  const Ran direct = record("exec 3<>" + device.path() + "; exit 3");
  EXPECT_EQ(direct.status, 3);
  EXPECT_THAT(direct.err, HasSubstr("-- /bin/bash -c 'exec 3<>{port}; exit 3'"));
}

TEST_F(RecordVerb, ASocketsPlaceHasParts) {
  const Ran ran = record(
      "test {port} = {host}:{tcp_port} && test \"$PORTTAPE_PORT\" = {port} && "
      "exec 3<>/dev/tcp/$PORTTAPE_HOST/$PORTTAPE_TCP_PORT; echo ask >&3; read answer <&3; test \"$answer\" = "
      "42",
      {"--driver", "tcp-listen:*:0"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(ran.out, "");
  EXPECT_THAT(ran.err, HasSubstr(" --driver 'tcp-listen:*:0' -- "));
}

TEST_F(RecordVerb, AUnixSocketsPlaceIsItsPath) {
  const std::string path = dir / "socket";
  const Ran ran = record("test {port} = " + path + " && test -S {port}", {"--driver", "unix-listen:" + path});
  EXPECT_EQ(ran.status, 0) << ran.err;
}

TEST_F(RecordVerb, WrongUseIsTwo) {
  EXPECT_EQ(run({"record", "--tape", tape, "--", "true"}).status, 2);
  EXPECT_EQ(run({"record", "--device", device.path(), "--", "true"}).status, 2);
  EXPECT_EQ(run({"record", "--device", device.path(), "--tape", tape}).status, 2);
  EXPECT_EQ(
      run({"record", "--device", device.path(), "--tape", tape, "--strictness", "1", "--", "true"}).status,
      2);
}

TEST_F(RecordVerb, HelpHasTheDaemonsOptions) {
  const Ran ran = run({"record", "--help"});
  EXPECT_EQ(ran.status, 0);
  for (const char* part :
       {"--fail-closed", "--on-existing", "--wait-device", "Example:\n  porttape record", "{port}"})
    EXPECT_THAT(ran.out, HasSubstr(part));
}

}  // namespace
}  // namespace porttape::test
