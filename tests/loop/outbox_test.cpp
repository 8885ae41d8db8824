#include "libport/loop/outbox.hpp"

#include <cerrno>
#include <fcntl.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/port_log.hpp"

namespace porttape {
namespace {

TEST(Outbox, DrainsAgainAfterAnErrorAndANewBeginning) {
  Loop loop;
  const UniqueFd fd(::open("/dev/full", O_WRONLY | O_CLOEXEC));
  int error = 0;
  std::size_t lost = 0;
  bool drained = false;
  Outbox* flushed = nullptr;
  FdWatch watch(
      loop, fd.get(), [] {}, [&flushed] { flushed->flush(); });
  Outbox outbox(
      fd.get(), Outbox::Kind::file, watch, [&drained] { drained = true; },
      [&](int number, std::size_t bytes) {
        error = number;
        lost += bytes;
      });
  flushed = &outbox;
  outbox.write(as_bytes("lost"));
  EXPECT_EQ(error, ENOSPC);
  EXPECT_EQ(lost, 4U);

  int ends[2];
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends), 0);
  const UniqueFd near(ends[0]);
  const UniqueFd far(ends[1]);
  ASSERT_GE(::dup2(near.get(), fd.get()), 0);
  outbox.discard();
  const std::string block(65536, 'b');
  while (!outbox.congested()) outbox.write(as_bytes(block));
  const Reader reader(loop, far.get());
  run_until(loop, [&] { return drained; });
  EXPECT_EQ(lost, 4U);
}

}  // namespace
}  // namespace porttape
