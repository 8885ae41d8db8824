// --record-mode: what is recorded, what is played, and that nothing reaches a device that must not.
#include <cstdlib>
#include <filesystem>
#include <poll.h>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/sockets.hpp"
#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

// A variable of the environment, as it was before at the end.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) {
    const char* const before = std::getenv(name);
    if (before != nullptr) before_ = before;
    had_ = before != nullptr;
    value == nullptr ? ::unsetenv(name) : ::setenv(name, value, 1);
  }
  ~Variable() { had_ ? ::setenv(name_, before_.c_str(), 1) : ::unsetenv(name_); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
  std::string before_;
  bool had_ = false;
};

class Cassettes : public testing::Test {
 protected:
  Ran run_verb(const std::string& verb, const std::string& tape, std::vector<std::string> options,
               const std::string& command) const {
    options.insert(options.begin(), {verb, "--tape", dir / tape, "--device", device()});
    options.insert(options.end(), {"--", "/bin/sh", "-c", command});
    return run(options);
  }
  [[nodiscard]] std::string device() const { return "tcp:127.0.0.1:" + std::to_string(listening.port()); }
  // Somebody has connected, or tries to.
  [[nodiscard]] bool was_opened() const {
    pollfd waiting{.fd = listening.fd(), .events = POLLIN, .revents = 0};
    return ::poll(&waiting, 1, 0) > 0;
  }

  TempDir dir;
  Socket listening = Socket::listening();
  Variable no_ci{"CI", nullptr};
  static constexpr const char* kAsk = "exec 3<>{port}; echo ask >&3; read answer <&3";
};

TEST_F(Cassettes, OnceRecordsWhatIsNotThere) {
  const Ran ran =
      run_verb("test", "new", {"--record-mode", "once", "--junit", dir / "j.xml"}, "echo ask >{port}");
  EXPECT_TRUE(was_opened());
  EXPECT_THAT(ran.err, HasSubstr("porttape record: "));
  EXPECT_TRUE(std::filesystem::exists(dir / "new.logw")) << ran.err;
  EXPECT_THAT(std::string(as_text(read_file(dir / "j.xml"))), HasSubstr("skipped=\"1\""));
}

TEST_F(Cassettes, ADriverThatRecordsNothingIsNoPass) {
  const Ran ran = run_verb("test", "new", {"--record-mode", "once"}, "true");
  EXPECT_EQ(ran.status, 5) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("incomplete: nothing was recorded"));
  EXPECT_FALSE(std::filesystem::exists(dir / "new.logw"));
}

// 3, 4 and 5 are verdicts, and a recording has none.
TEST_F(Cassettes, TheStatusOfACommandThatWasRecordedIsNoVerdict) {
  for (const int status : {3, 4, 5, 77}) {
    const std::string tape = "t" + std::to_string(status);
    const Ran ran =
        run_verb("test", tape, {"--record-mode", "once"}, "echo ask >{port}; exit " + std::to_string(status));
    EXPECT_EQ(ran.status, 1) << ran.err;
    EXPECT_THAT(ran.err, HasSubstr("the command ended with status " + std::to_string(status)));
    EXPECT_TRUE(std::filesystem::exists(dir / (tape + ".logw"))) << ran.err;
  }
}

TEST_F(Cassettes, FaultsOfTheTestAreNotRecorded) {
  const Ran ran =
      run_verb("test", "new", {"--record-mode", "once", "--faults", "drop:p=1:dir=both"}, "echo ask >{port}");
  EXPECT_THAT(ran.err, HasSubstr("without the faults"));
  EXPECT_EQ(std::filesystem::file_size(dir / "new.logw"), 12U + 4) << ran.err;
}

TEST_F(Cassettes, OncePlaysWhatIsThereAndNeverOpensTheDevice) {
  make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}});
  for (const char* verb : {"test", "record"}) {
    const Ran ran = run_verb(verb, "t", {"--record-mode", "once"}, kAsk);
    EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
    EXPECT_THAT(ran.out, HasSubstr("pass  "));
  }
  EXPECT_FALSE(was_opened());
}

TEST_F(Cassettes, NoneNeverOpensTheDevice) {
  make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}});
  for (const std::vector<std::string>& options : {std::vector<std::string>{}, {"--record-mode", "none"}})
    EXPECT_EQ(run_verb("test", "t", options, kAsk).status, 0);
  const Ran ran = run_verb("test", "missing", {"--record-mode", "none"}, kAsk);
  EXPECT_EQ(ran.status, 2);
  EXPECT_THAT(ran.err, HasSubstr("--record-mode once records it from --device"));
  EXPECT_FALSE(was_opened());
  EXPECT_FALSE(std::filesystem::exists(dir / "missing.logw"));
}

TEST_F(Cassettes, UnderCiOnceIsNoneAndSaysSo) {
  const Variable ci("CI", "true");
  const Ran missing = run_verb("test", "missing", {"--record-mode", "once"}, kAsk);
  EXPECT_EQ(missing.status, 2);
  EXPECT_THAT(missing.err, HasSubstr("under CI nothing is recorded: record it where the device is"));
  make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}});
  const Ran there = run_verb("test", "t", {"--record-mode", "once"}, kAsk);
  EXPECT_EQ(there.status, 0);
  EXPECT_THAT(there.err, HasSubstr("under CI nothing is recorded: --record-mode none instead of once"));
  EXPECT_FALSE(was_opened());
}

TEST_F(Cassettes, WhatCannotBeIsTold) {
  EXPECT_EQ(run({"test", "--tape", dir / "x", "--record-mode", "once", "--", "true"}).status, 2);
  EXPECT_THAT(run({"test", "--tape", dir / "x", "--record-mode", "once", "--", "true"}).err,
              HasSubstr("there is no --device to record it from"));
  EXPECT_THAT(run_verb("test", "x", {"--record-mode", "all"}, kAsk).err, HasSubstr("accepted: none, once"));
}

}  // namespace
}  // namespace porttape::test
