#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "daemon/log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

TEST(Log, NothingInAMessageIsObeyedByATerminal) {
  const test::TempDir dir;
  {
    const auto log = make_log({.file = dir / "log"}, spdlog::level::info);
    ASSERT_TRUE(log.has_value());
    log->logger->info("{}: cannot be opened", "/tmp/\x1b[31m\u009b\u202e\x7f");
  }
  const Bytes bytes = test::read_file(dir / "log");
  EXPECT_THAT(std::string(as_text(bytes)),
              testing::HasSubstr("/tmp/\\x1b[31m\\x9b\\u{202e}\\x7f: cannot be opened\n"));
}

}  // namespace
}  // namespace porttape
