#pragma once

#include <fcntl.h>
#include <map>
#include <memory>
#include <string>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tty/serial_port.hpp"
#include "libport/tty/types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {

// The device is the slave of a pty whose master the test holds.
class SerialPortTest : public testing::Test {
 protected:
  SerialPortTest() : device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    ::grantpt(device.get());
    ::unlockpt(device.get());
    path = ::ptsname(device.get());
  }

  void make_port(std::map<std::string, std::string> options = {}) {
    options.try_emplace("device", path);
    const Result<PortOptions> checked = check_options(PortOptions{&type, std::move(options)});
    const Result<PortSpec> spec = PortSpec::read(*checked);
    SerialOptions own = *spec->get<SerialOptions>();
    own.lock_folder = locks.path().string();
    port = std::make_unique<SerialPort>(PortContext{&loop, book.log()}, spec->common(), own, calls);
    port->listen(log);
  }
  Error prepare_error(const std::string& device_path) {
    make_port({{"device", device_path}});
    const Result<void> prepared = port->prepare();
    EXPECT_FALSE(prepared.has_value()) << device_path;
    return prepared ? Error{} : prepared.error();
  }

  [[nodiscard]] std::filesystem::path lock_of(const std::string& device_path) const {
    return locks.path() / ("LCK.." + std::filesystem::path(device_path).filename().string());
  }

  const PortType type = serial_type();
  const test::TempDir locks;
  UniqueFd device;
  std::string path;
  Loop loop;
  LogBook book;
  PortLog log;
  std::shared_ptr<LineCalls> calls = LineCalls::of_system();
  std::unique_ptr<SerialPort> port;
};

}  // namespace porttape
