#include "libport/net/name_lookup.hpp"

#include <cerrno>
#include <memory>
#include <optional>
#include <string>
#include <sys/syscall.h>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "libport/loop/loop.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

const std::vector<test::RefusedCall> kNoThreads{{SYS_clone3, EAGAIN}, {SYS_clone, EAGAIN}};

class NameLookupTest : public testing::Test {
 protected:
  void look_up(const std::string& host) {
    lookup = std::make_unique<NameLookup>(loop, host, 4001,
                                          [this](const Result<std::vector<SocketAddress>>& found) {
                                            ++calls;
                                            caller = std::this_thread::get_id();
                                            addresses = found;
                                          });
  }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }

  Loop loop;
  std::unique_ptr<NameLookup> lookup;
  int calls = 0;
  std::thread::id caller;
  std::optional<Result<std::vector<SocketAddress>>> addresses;
};

TEST_F(NameLookupTest, GivesTheAddressesOnceAndFromTheLoop) {
  look_up("127.0.0.1");
  EXPECT_EQ(calls, 0);
  run_until(loop, [this] { return calls > 0; });
  run_ready();
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(caller, std::this_thread::get_id());
  ASSERT_TRUE(addresses && addresses->has_value());
  ASSERT_EQ((*addresses)->size(), 1U);
  EXPECT_EQ((**addresses)[0].text(), "127.0.0.1:4001");
}

TEST_F(NameLookupTest, OneThatIsDestroyedCallsNobody) {
  look_up("127.0.0.1");
  lookup.reset();
  bool over = false;
  ASSERT_TRUE(loop.run_elsewhere(
      {}, [] {}, [&over] { over = true; }));
  run_until(loop, [&over] { return over; });
  while (loop.run_one()) {
  }
  EXPECT_EQ(calls, 0);
}

TEST_F(NameLookupTest, TheCallbackMayDestroyIt) {
  lookup = std::make_unique<NameLookup>(loop, "127.0.0.1", 4001, [this](const auto&) {
    lookup.reset();
    ++calls;
  });
  run_until(loop, [this] { return calls > 0; });
  EXPECT_EQ(calls, 1);
}

TEST_F(NameLookupTest, WithoutAThreadItFailsFromTheLoopAndSaysWhy) {
  EXPECT_TRUE(test::holds_without(kNoThreads, [this] {
    look_up("127.0.0.1");
    EXPECT_EQ(calls, 0);
    run_until(loop, [this] { return calls > 0; });
    ASSERT_TRUE(addresses && !addresses->has_value());
    EXPECT_EQ(addresses->error().code, Errc::io);
    EXPECT_EQ(addresses->error().message, "no thread for a name lookup; raise the limit of processes");
  }));
}

}  // namespace
}  // namespace porttape
