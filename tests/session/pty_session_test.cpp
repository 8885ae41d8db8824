// A session in front of a real pty whose device comes up late, jams and goes away, driven by random
// schedules: no byte is lost, none comes twice or out of order, and none before the device is up.

#include <chrono>
#include <cstdint>
#include <fcntl.h>
#include <memory>
#include <random>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/session/session.hpp"
#include "libport/tty/pty_port.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

constexpr int kSeeds = 60;
constexpr int kSteps = 60;

class PtySession {
 public:
  explicit PtySession(std::uint64_t seed) : link((dir.path() / "port").string()), random_(seed) {
    const PortContext context{&loop, book.log()};
    device.up_at_once = false;
    session = std::make_unique<Session>(context, std::make_unique<PtyPort>(context, PtyOptions{.link = link}),
                                        std::make_unique<MemoryPort>(device), [](int) {});
  }

  std::uint32_t dice(std::uint32_t n) { return static_cast<std::uint32_t>(random_() % n); }

  void open_driver() {
    if (!driver) driver.reset(::open(link.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
    ASSERT_TRUE(driver);
  }
  void write(std::size_t size) {
    std::string text(size, '\0');
    for (char& c : text) c = static_cast<char>('a' + next_++ % 26);
    const ssize_t took = ::write(driver.get(), text.data(), text.size());
    if (took > 0) written.append(text, 0, static_cast<std::size_t>(took));
    next_ -= text.size() - (took > 0 ? static_cast<std::size_t>(took) : 0);
  }
  // What is there is handled, or only some of it.
  void run(std::uint32_t most) {
    for (std::uint32_t n = 0; n < most && loop.poll_one(); ++n) {
    }
    loop.restart();
  }
  [[nodiscard]] bool device_wants_up() const {
    const std::size_t open = device.calls.rfind("open ");
    if (open == std::string::npos) return false;
    const std::size_t close = device.calls.rfind("close ");
    return (close == std::string::npos || close < open) && up_at_ != open;
  }
  void device_up() {
    if (!device_wants_up()) return;
    up_at_ = device.calls.rfind("open ");
    device.up();
  }
  void step() {
    switch (dice(8)) {
      case 0:
        return open_driver();
      case 1:
        return driver.reset();
      case 2:  // in one breath, as a stalled daemon finds it
        if (driver) write(1 + dice(20));
        driver.reset();
        open_driver();
        return write(1 + dice(20));
      case 3:
        if (driver) write(1 + dice(dice(4) == 0 ? 5000 : 50));
        return;
      case 4:
        return device_up();
      case 5:
        if (device.congested) return device.drain();
        device.congested = dice(3) == 0;
        return;
      default:
        return run(dice(2) == 0 ? 1 + dice(3) : 100);
    }
  }
  // Lets everything pass.
  void settle() {
    if (device.congested) device.drain();
    run_until(loop, [this] {
      device_up();
      return device.written.size() >= written.size();
    });
  }

  test::TempDir dir;
  std::string link;
  Loop loop;
  LogBook book;
  MemoryPort::Peer device;
  std::unique_ptr<Session> session;
  UniqueFd driver;
  std::string written;

 private:
  std::mt19937_64 random_;
  std::size_t next_ = 0;
  std::size_t up_at_ = std::string::npos;
};

TEST(PtySession, WriteCloseOpenWriteBeforeWeLookReachesADeviceThatComesUpLate) {
  PtySession rig(1);
  ASSERT_TRUE(rig.session->start().has_value());
  rig.open_driver();
  rig.run(100);
  rig.device_up();
  rig.write(3);
  rig.driver.reset();
  rig.open_driver();
  rig.write(3);
  rig.run(100);
  EXPECT_EQ(rig.book.text().find("was not to read"), std::string::npos) << rig.book.text();
  EXPECT_EQ(rig.device.written, "") << "before the second session's device is up";
  rig.settle();
  EXPECT_EQ(rig.device.written, rig.written);
  EXPECT_EQ(rig.session->counters().dropped_bytes, 0U);
}

TEST(PtySession, RandomSchedulesLoseNothing) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    PtySession rig(seed);
    ASSERT_TRUE(rig.session->start().has_value());
    for (int n = 0; n < kSteps; ++n) rig.step();
    rig.settle();
    ASSERT_EQ(rig.device.written, rig.written);
    ASSERT_EQ(rig.session->counters().dropped_bytes, 0U) << rig.book.text();
    ASSERT_EQ(rig.book.text().find("was not to read"), std::string::npos) << rig.book.text();
  }
}

TEST(PtySessionEnd, WhatADriverWroteForADeviceThatIsNotThereIsTold) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "port").string();
  Loop loop;
  LogBook book;
  MemoryPort::Peer device;
  device.up_at_once = false;
  const PortContext context{&loop, book.log()};
  bool ended = false;
  Session session(context, std::make_unique<PtyPort>(context, PtyOptions{.link = link}),
                  std::make_unique<MemoryPort>(device), [&ended](int) { ended = true; });
  ASSERT_TRUE(session.start().has_value());
  UniqueFd driver(::open(link.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  ASSERT_EQ(::write(driver.get(), "hello", 5), 5);
  run_until(loop, [&] { return device.calls.find("open ") != std::string::npos; });
  driver.reset();
  session.stop();
  run_until(loop, [&ended] { return ended; });
  EXPECT_EQ(device.written, "");
  EXPECT_EQ(device.gaps, 5U);
  EXPECT_NE(book.text().find("5 bytes reached nobody"), std::string::npos) << book.text();
}

}  // namespace
}  // namespace porttape
