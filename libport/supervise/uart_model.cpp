#include "libport/supervise/uart_model.hpp"

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <linux/tty_flags.h>

namespace porttape {
namespace {

constexpr unsigned kRateOfItsOwn = 38400;  // stands for what ASYNC_SPD_… says, where that says something

// The kernel's, for a program of 32 bits: some members are pointers.
struct SmallSerialStruct {
  int type;
  int line;
  unsigned port;
  int irq;
  int flags;
  int xmit_fifo_size;
  int custom_divisor;
  int baud_base;
  unsigned short close_delay;
  char io_type;
  char reserved_char;
  int hub6;
  unsigned short closing_wait;
  unsigned short closing_wait2;
  unsigned iomem_base;
  unsigned short iomem_reg_shift;
  unsigned port_high;
  int reserved;
};

// Until there both are the same.
constexpr std::size_t kCommonPart = offsetof(SmallSerialStruct, iomem_base);
static_assert(offsetof(SmallSerialStruct, closing_wait2) == offsetof(serial_struct, closing_wait2));
constexpr unsigned kNoSmallAddress = 0xfffffff;  // the kernel's word for one that does not fit

}  // namespace

UartModel::UartModel() {
  serial_.type = PORT_16550A;
  serial_.xmit_fifo_size = 16;
  serial_.baud_base = 115200;
  serial_.close_delay = 50;     // hundredths of a second
  serial_.closing_wait = 3000;  // the same
}

void UartModel::make(const serial_struct& wanted) {
  serial_.flags = wanted.flags;
  serial_.custom_divisor = wanted.custom_divisor;
  serial_.close_delay = wanted.close_delay;
  serial_.closing_wait = wanted.closing_wait;
}

bool UartModel::may_anybody(const serial_struct& now, const serial_struct& wanted) {
  const auto flags = static_cast<unsigned>(now.flags ^ wanted.flags);
  return now.type == wanted.type && now.port == wanted.port && now.port_high == wanted.port_high &&
         now.irq == wanted.irq && now.io_type == wanted.io_type && now.hub6 == wanted.hub6 &&
         now.iomem_base == wanted.iomem_base && now.iomem_reg_shift == wanted.iomem_reg_shift &&
         now.baud_base == wanted.baud_base && now.xmit_fifo_size == wanted.xmit_fifo_size &&
         now.close_delay == wanted.close_delay && now.closing_wait == wanted.closing_wait &&
         (flags & ~static_cast<unsigned>(ASYNC_USR_MASK)) == 0;
}

unsigned UartModel::rate_of(unsigned baud) const {
  if (baud != kRateOfItsOwn) return baud;
  switch (static_cast<unsigned>(serial_.flags) & ASYNC_SPD_MASK) {
    case ASYNC_SPD_HI:
      return 57600;
    case ASYNC_SPD_VHI:
      return 115200;
    case ASYNC_SPD_SHI:
      return 230400;
    case ASYNC_SPD_WARP:
      return 460800;
    case ASYNC_SPD_CUST:
      return serial_.custom_divisor > 0 ? static_cast<unsigned>(serial_.baud_base / serial_.custom_divisor)
                                        : baud;
    default:
      return baud;
  }
}

std::optional<serial_struct> read_serial(const Call& call, std::uint64_t address) {
  if (!call.is_small()) return call.read_as<serial_struct>(address);
  const auto small = call.read_as<SmallSerialStruct>(address);
  if (!small) return std::nullopt;
  serial_struct serial{};
  std::memcpy(&serial, &*small, kCommonPart);
  // NOLINTNEXTLINE(performance-no-int-to-ptr): the device's, not ours
  serial.iomem_base = reinterpret_cast<unsigned char*>(static_cast<std::uintptr_t>(small->iomem_base));
  serial.iomem_reg_shift = small->iomem_reg_shift;
  serial.port_high = small->port_high;
  return serial;
}

bool write_serial(const Call& call, std::uint64_t address, const serial_struct& serial) {
  if (!call.is_small()) return call.write_as(address, serial);
  SmallSerialStruct small{};
  std::memcpy(&small, &serial, kCommonPart);
  const auto base = reinterpret_cast<std::uintptr_t>(serial.iomem_base);
  small.iomem_base = (base >> 31U) >> 1U != 0 ? kNoSmallAddress : static_cast<unsigned>(base);
  small.iomem_reg_shift = serial.iomem_reg_shift;
  small.port_high = static_cast<unsigned>(serial.port_high);
  return call.write_as(address, small);
}

}  // namespace porttape
