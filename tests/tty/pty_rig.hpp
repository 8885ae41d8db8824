#pragma once

#include <fcntl.h>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tty/pty_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {

// A pty with a link, which the test opens as a driver does.
class PtyPortTest : public testing::Test {
 protected:
  PtyPortTest() : link((dir.path() / "port").string()), port(PortContext{&loop, book.log()}, options()) {
    port.listen(log);
  }

  [[nodiscard]] PtyOptions options() const { return {.link = link}; }
  void start() {
    const Result<void> prepared = port.prepare();
    ASSERT_TRUE(prepared.has_value()) << prepared.error().message;
    port.open();
  }
  [[nodiscard]] UniqueFd driver(int flags = O_RDWR | O_NOCTTY | O_NONBLOCK) const {
    return UniqueFd(::open(link.c_str(), flags));
  }
  void until(const std::string& events) {
    run_until(loop, [&] { return log.events == events; });
    EXPECT_EQ(log.events, events);
  }
  static std::string read_some(const UniqueFd& fd) {
    char buffer[256];
    const ssize_t size = ::read(fd.get(), buffer, sizeof buffer);
    return size > 0 ? std::string(buffer, static_cast<std::size_t>(size)) : std::string();
  }
  // The kernel hands bytes to the slave from a work queue.
  static std::string read_all(const UniqueFd& fd, std::size_t size) {
    ::fcntl(fd.get(), F_SETFL, ::fcntl(fd.get(), F_GETFL) & ~O_NONBLOCK);
    std::string text;
    while (text.size() < size) text += read_some(fd);
    return text;
  }

  test::TempDir dir;
  std::string link;
  Loop loop;
  LogBook book;
  PortLog log;
  PtyPort port;
};

}  // namespace porttape
