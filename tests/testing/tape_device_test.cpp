#include "libport/testing/tape_device.hpp"

#include <fcntl.h>
#include <stdexcept>
#include <string>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class TapeDevices : public testing::Test {
 protected:
  // One exchange: "ask\n" is answered by "42\n".
  TapeDevices() {
    write_file(dir / "t.logr", block_bytes({{2000, "42\n"}}));
    write_file(dir / "t.logw", block_bytes({{1000, "ask\n"}}));
  }
  // A driver: what it is answered, a byte at a time.
  static std::string ask(const std::string& port, const std::string& question) {
    const UniqueFd fd(::open(port.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
    EXPECT_TRUE(fd);
    EXPECT_EQ(::write(fd.get(), question.data(), question.size()), static_cast<ssize_t>(question.size()));
    std::string answer;
    char byte = 0;
    while (!answer.ends_with('\n') && ::read(fd.get(), &byte, 1) == 1) answer += byte;
    return answer;
  }

  TempDir dir;
  std::string tape = dir / "t";
};

TEST_F(TapeDevices, PassesWhereTheDriverDoesAsRecorded) {
  TapeDevice device(tape);
  EXPECT_EQ(ask(device.port(), "ask\n"), "42\n");
  EXPECT_TRUE(device.verdict()) << device.verdict();
  EXPECT_THAT(device.verdict().text, StartsWith("pass  "));
  EXPECT_THAT(device.verdict().json, StartsWith("{\"verdict\":\"pass\",\"exit\":0,"));
  EXPECT_NE(::access(device.port().c_str(), F_OK), 0) << "the port is still there";
}

TEST_F(TapeDevices, FailsWithTheReportsText) {
  TapeDevice device(tape);
  EXPECT_EQ(ask(device.port(), "axk\n"), "");
  EXPECT_FALSE(device.verdict());
  EXPECT_EQ(device.verdict().exit_status, 3);
  EXPECT_THAT(device.verdict().text, StartsWith("data mismatch: the driver wrote \"axk\\n\""));
}

TEST_F(TapeDevices, ADriverThatNeverCameIsIncomplete) {
  TapeDevice device(tape);
  EXPECT_EQ(device.verdict().exit_status, 5) << device.verdict();
}

TEST_F(TapeDevices, ADriverThatStillHasThePortIsNoHindrance) {
  TapeDevice device(tape);
  const UniqueFd fd(::open(device.port().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_EQ(::write(fd.get(), "ask\n", 4), 4);
  std::string answer(3, '\0');
  ASSERT_EQ(::read(fd.get(), answer.data(), answer.size()), 3);
  EXPECT_TRUE(device.verdict()) << device.verdict();
}

TEST_F(TapeDevices, TakesTheOptionsOfPorttapeTest) {
  TapeDevice device(tape, {{"driver", "tcp-listen:127.0.0.1:0"}});
  EXPECT_EQ(device.host(), "127.0.0.1");
  EXPECT_EQ(device.port(), "127.0.0.1:" + std::to_string(device.tcp_port()));
  EXPECT_THROW(TapeDevice(tape, {{"strictness", "3"}}), std::runtime_error);
}

TEST_F(TapeDevices, SaysWhatIsWrong) {
  try {
    TapeDevice device(dir / "none");
    FAIL() << "no tape was needed";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("no tape '"));
  }
  EXPECT_THROW(TapeDevice(tape, {{"driver", "pty:/no/such/folder/port"}}), std::runtime_error);
}

TEST_F(TapeDevices, SeveralPlayAtTheSameTime) {
  TapeDevice one(tape);
  TapeDevice other(tape);
  EXPECT_NE(one.port(), other.port());
  EXPECT_EQ(ask(other.port(), "ask\n"), "42\n");
  EXPECT_EQ(ask(one.port(), "ask\n"), "42\n");
  EXPECT_TRUE(one.verdict()) << one.verdict();
  EXPECT_TRUE(other.verdict()) << other.verdict();
}

}  // namespace
}  // namespace porttape::test
