// A tape that the system does not let be read as it is to be replayed.

#include <cerrno>
#include <cstddef>
#include <memory>
#include <string>
#include <sys/syscall.h>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/taped/replayed_device.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::MemoryTape;
using testing::HasSubstr;

class ReplayRefused : public testing::Test {
 protected:
  [[nodiscard]] Result<void> prepare(Match match) {
    ReplayOptions options;
    options.tape = tape;
    options.config.match = match;
    options.config.timing = Timing::none;
    port = std::make_unique<ReplayedDevice>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    return port->prepare();
  }

  test::TempDir dir;
  const TapePaths tape = test::write_tape(literal_tape(dir / "t.log"),
                                          MemoryTape().open(0).write(1, "ask").read(2, "answer").close(3),
                                          {.device = "d", .driver = "p", .id = "0123"});
  Loop loop;
  LogBook book;
  PortLog log;
  std::unique_ptr<ReplayPort> port;
};

TEST_F(ReplayRefused, WhereDescriptorsRunOutItIsToldWhicheverIsTheFirst) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  std::size_t needed = 0;
  for (const Match match : {Match::sequence, Match::lookup}) {
    std::size_t left = 0;
    for (bool prepared = false; !prepared; ++left) {
      ASSERT_LT(left, 30U);
      port.reset();
      const test::FewDescriptors few(unsanitized, left);
      const Result<void> done = prepare(match);
      prepared = done.has_value();
      if (prepared) continue;
      EXPECT_EQ(done.error().code, Errc::io) << left;
      EXPECT_EQ(done.error().message.substr(0, 12), "cannot read ") << left;
      EXPECT_THAT(done.error().message, HasSubstr(": Too many open files")) << left;
    }
    EXPECT_GT(left, needed) << "what is looked up is read by more";
    needed = left;
  }
}

TEST_F(ReplayRefused, WhatCannotBeReadIsTold) {
  for (const Match match : {Match::sequence, Match::lookup}) {
    for (const int error : {EIO, ESTALE}) {
      EXPECT_TRUE(test::holds_without({{SYS_pread64, error}}, [&] {
        const Result<void> done = prepare(match);
        ASSERT_FALSE(done);
        EXPECT_EQ(done.error().code, Errc::io);
        EXPECT_THAT(done.error().message, HasSubstr(errno_text(error)));
        EXPECT_THAT(done.error().message, HasSubstr(dir.path().string()));
      }));
    }
  }
}

}  // namespace
}  // namespace porttape
