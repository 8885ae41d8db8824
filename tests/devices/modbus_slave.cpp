// An energy meter on Modbus RTU or TCP, built on libmodbus: the device of the modbus scenarios and of the
// demo.
//
//   modbus_slave TTY [BAUD] [b]
//   modbus_slave tcp:PORT          on 127.0.0.1, one connection after the other
//
// Holding registers 0-255 hold 1000 + n, input registers n * 257, coils are on when odd, discrete inputs
// every third. Input registers 200-205 are the meter: tenths of a volt, milliamperes, energy in Wh (two
// registers, high word first), hundredths of a hertz, status. The energy grows by 3 Wh with each request that
// reads it. With `b` it is hardware revision B: its RS-485 transceiver is switched on too early before every
// fourth answer, which puts one stray zero byte on the line ahead of the frame.

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <modbus/modbus.h>
#include <unistd.h>

namespace {

constexpr int kSlave = 1;
constexpr int kBits = 64;
constexpr int kRegisters = 256;
constexpr int kMeter = 200;
constexpr int kStrayEvery = 4;

void fill(modbus_mapping_t& map) {
  for (int n = 0; n < kRegisters; ++n) {
    map.tab_registers[n] = static_cast<std::uint16_t>(1000 + n);
    map.tab_input_registers[n] = static_cast<std::uint16_t>(n * 257);
  }
  for (int n = 0; n < kBits; ++n) {
    map.tab_bits[n] = n % 2 == 1;
    map.tab_input_bits[n] = n % 3 == 0;
  }
}

void measure(modbus_mapping_t& map, unsigned request) {
  const std::uint32_t energy = 1'048'560 + 3 * request;  // its low word wraps during a session
  std::uint16_t* meter = map.tab_input_registers + kMeter;
  meter[0] = static_cast<std::uint16_t>(2300 + request % 7);
  meter[1] = static_cast<std::uint16_t>(4120 + request * 13 % 40);
  meter[2] = static_cast<std::uint16_t>(energy >> 16);
  meter[3] = static_cast<std::uint16_t>(energy & 0xFFFF);
  meter[4] = static_cast<std::uint16_t>(4998 + request % 5);
  meter[5] = 0;
}

using Bus = std::unique_ptr<modbus_t, decltype(&modbus_free)>;

int serve(modbus_t* bus, modbus_mapping_t& map, bool revision_b) {
  std::uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
  for (unsigned count = 1;;) {
    const int length = modbus_receive(bus, request);
    if (length == 0) continue;  // for another slave
    if (length < 0) {
      if (errno == EMBBADCRC || errno == ETIMEDOUT || errno == EAGAIN) continue;
      return errno == EIO || errno == ECONNRESET ? 0 : 1;  // the line was hung up
    }
    measure(map, count);
    if (revision_b && count % kStrayEvery == 0) {
      constexpr std::uint8_t kStray = 0;
      if (write(modbus_get_socket(bus), &kStray, 1) != 1) return 1;
    }
    modbus_reply(bus, request, length, &map);
    ++count;
  }
}

int serve_tcp(int port, modbus_mapping_t& map) {
  const Bus bus(modbus_new_tcp("127.0.0.1", port), modbus_free);
  int listener = bus ? modbus_tcp_listen(bus.get(), 1) : -1;
  if (listener < 0) {
    std::fprintf(stderr, "modbus_slave: port %d: %s\n", port, modbus_strerror(errno));
    return 1;
  }
  for (;;) {
    if (modbus_tcp_accept(bus.get(), &listener) < 0) return 1;
    (void)serve(bus.get(), map, false);
    modbus_close(bus.get());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    std::fprintf(stderr, "usage: modbus_slave TTY [BAUD] [b] | modbus_slave tcp:PORT\n");
    return 64;
  }
  const std::unique_ptr<modbus_mapping_t, decltype(&modbus_mapping_free)> map(
      modbus_mapping_new(kBits, kBits, kRegisters, kRegisters), modbus_mapping_free);
  if (!map) return 1;
  fill(*map);
  if (std::strncmp(argv[1], "tcp:", 4) == 0) return serve_tcp(std::atoi(argv[1] + 4), *map);
  const int baud = argc > 2 ? std::atoi(argv[2]) : 19200;
  const bool revision_b = argc > 3 && std::strcmp(argv[3], "b") == 0;
  const Bus bus(modbus_new_rtu(argv[1], baud, 'N', 8, 1), modbus_free);
  if (!bus || modbus_set_slave(bus.get(), kSlave) != 0 || modbus_connect(bus.get()) != 0) {
    std::fprintf(stderr, "modbus_slave: %s: %s\n", argv[1], modbus_strerror(errno));
    return 1;
  }
  return serve(bus.get(), *map, revision_b);
}
