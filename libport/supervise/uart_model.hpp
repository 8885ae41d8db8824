#pragma once

#include <linux/serial.h>
#include <optional>

#include "libport/supervise/call.hpp"

namespace porttape {

// What a driver is told of the UART (TIOCGSERIAL) and of RS-485: what it made of them itself, where no device
// says otherwise. A plain value.
class UartModel {
 public:
  UartModel();

  [[nodiscard]] const serial_struct& serial() const { return serial_; }
  [[nodiscard]] const serial_rs485& rs485() const { return rs485_; }
  // As the device has them.
  void show(const serial_struct& serial) { serial_ = serial; }
  void show(const serial_rs485& rs485) { rs485_ = rs485; }
  // The driver's wish, of which it may change what the kernel's serial drivers let it: the rest is the
  // hardware's.
  void make(const serial_struct& wanted);

  // Whether the kernel's serial drivers let anybody change one into the other: the flags of ASYNC_USR_MASK
  // and the divisor. All else takes CAP_SYS_ADMIN (serial_core.c, uart_set_info()).
  [[nodiscard]] static bool may_anybody(const serial_struct& now, const serial_struct& wanted);

  // The rate that `baud` stands for: 38400 for another where the driver has said so.
  [[nodiscard]] unsigned rate_of(unsigned baud) const;

 private:
  serial_struct serial_{};
  serial_rs485 rs485_{};
};

// As the program of a call has it at that address.
std::optional<serial_struct> read_serial(const Call& call, std::uint64_t address);
bool write_serial(const Call& call, std::uint64_t address, const serial_struct& serial);

}  // namespace porttape
