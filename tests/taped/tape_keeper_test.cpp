// The keeper of a tape whose disk does not answer at the end.

#include "libport/taped/tape_keeper.hpp"

#include <functional>
#include <future>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

class TapeKeeperTest : public testing::Test {
 protected:
  // A disk that hangs while a tape's files are made.
  struct HungDisk {
    std::promise<std::function<void()>> reached;  // with the tape's on_news
    std::promise<void> goes_on;
  };

  TapeKeeperTest() {
    keeper = std::make_unique<TapeKeeper>(
        PortContext{&loop, book.log()},
        TapeKeeper::Options{.tape = literal_tape("x.log"),
                            .header = {.device = "memory", .driver = "test"},
                            .make = [disk = disk](const LiveTape::Options& tape) -> Result<TapeWriter> {
                              disk->reached.set_value(tape.on_news);
                              disk->goes_on.get_future().wait();
                              return make_error(Errc::io, "a test wants it");
                            }},
        [] {});
  }
  ~TapeKeeperTest() override { disk->goes_on.set_value(); }

  void run_posted() {
    bool ran = false;
    loop.post([&ran] { ran = true; });
    run_until(loop, [&ran] { return ran; });
  }

  std::shared_ptr<HungDisk> disk = std::make_shared<HungDisk>();
  Loop loop;
  LogBook book;
  std::unique_ptr<TapeKeeper> keeper;
};

TEST_F(TapeKeeperTest, WhatItsTapeTellsAfterItWasGivenUpCompletesNothing) {
  keeper->opened(loop.now());
  const std::function<void()> news = disk->reached.get_future().get();
  std::optional<bool> complete;
  keeper->finish(loop.now(), [&complete](bool all) { complete = all; });
  keeper->give_up();
  news();
  run_posted();
  EXPECT_EQ(complete, std::nullopt);
}

TEST_F(TapeKeeperTest, GivenUpItTellsHowManyBytesAreNotOnTheTape) {
  keeper->opened(loop.now());
  keeper->block(Direction::read, loop.now(), as_bytes("seven b"));
  keeper->finish(loop.now(), [](bool) {});
  keeper->give_up();
  EXPECT_NE(book.text().find("x.log: its disk did not answer in time; 7 bytes and the end are not on it"),
            std::string::npos)
      << book.text();
}

TEST_F(TapeKeeperTest, GivenUpWithoutAnEndItTellsThatToo) {
  keeper->opened(loop.now());
  keeper->block(Direction::read, loop.now(), as_bytes("seven b"));
  keeper->give_up();
  EXPECT_NE(book.text().find("7 bytes and the end are not on it"), std::string::npos) << book.text();
}

}  // namespace
}  // namespace porttape
