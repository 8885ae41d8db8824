#pragma once

#include <cstdint>
#include <functional>
#include <linux/serial.h>
#include <optional>

namespace porttape {

// What a driver asks of a serial device beside bytes, settings and signals.
struct LineRequest {
  enum class Kind : std::uint8_t {
    get_serial,  // TIOCGSERIAL
    set_serial,  // TIOCSSERIAL
    get_rs485,   // TIOCGRS485
    set_rs485,   // TIOCSRS485
    last_break   // whether the device took the break that was begun last
  };
  Kind kind = Kind::last_break;
  serial_struct serial = {};  // of set_serial
  serial_rs485 rs485 = {};    // of set_rs485
};

// What the device says to that.
struct LineAnswer {
  int error = 0;              // an error number
  serial_struct serial = {};  // of get_serial
  serial_rs485 rs485 = {};    // of both about it: as the device has it now
};

// Called once. Nothing: there is no serial device that could be asked.
using TakeAnswer = std::function<void(const std::optional<LineAnswer>& answer)>;

}  // namespace porttape
