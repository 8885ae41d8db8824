#pragma once

#include <memory>
#include <optional>
#include <string>

#include <gtest/gtest.h>

#include "libport/session/session.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {

// A session between two ports in memory, by a clock that is moved. A test calls start(), and may change the
// peers before.
class SessionRig : public testing::Test {
 protected:
  SessionRig() {
    driver.name = "driver";
    device.name = "device";
    driver.passive = true;
    driver.up_at_once = false;
  }
  void start() {
    session = std::make_unique<Session>(PortContext{&loop, book.log()}, std::make_unique<MemoryPort>(driver),
                                        std::make_unique<MemoryPort>(device),
                                        [this](int status) { end_status = status; });
    ASSERT_TRUE(session->start().has_value());
  }
  // Whether the log has it.
  [[nodiscard]] bool told(const std::string& text) const {
    return book.text().find(text) != std::string::npos;
  }

  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  MemoryPort::Peer driver;
  MemoryPort::Peer device;
  std::optional<int> end_status;
  std::unique_ptr<Session> session;
};

}  // namespace porttape
