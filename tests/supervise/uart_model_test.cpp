// A UART that is only told of, and the call of a program of 32 bits that asks for it: one of this process.

#include "libport/supervise/uart_model.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <linux/audit.h>
#include <linux/tty_flags.h>
#include <optional>
#include <utility>

#include <gtest/gtest.h>

#include "tests/supervise/own_call.hpp"

namespace porttape {
namespace {

using test::address_of;
using test::OwnCall;

TEST(UartModelValue, ItIsAPlain16550AUntilSomebodySaysOtherwise) {
  const UartModel uart;
  EXPECT_EQ(uart.serial().type, PORT_16550A);
  EXPECT_EQ(uart.serial().xmit_fifo_size, 16);
  EXPECT_EQ(uart.serial().baud_base, 115200);
  EXPECT_EQ(uart.serial().close_delay, 50);
  EXPECT_EQ(uart.serial().closing_wait, 3000);
  EXPECT_EQ(uart.serial().flags, 0);
  EXPECT_EQ(uart.rs485().flags, 0U);
}

TEST(UartModelValue, ADriverChangesWhatIsNotTheHardwares) {
  UartModel uart;
  serial_struct wanted{};
  wanted.type = PORT_8250;
  wanted.xmit_fifo_size = 7;
  wanted.baud_base = 9;
  wanted.flags = static_cast<int>(ASYNC_LOW_LATENCY);
  wanted.custom_divisor = 24;
  wanted.close_delay = 51;
  wanted.closing_wait = 52;
  uart.make(wanted);
  EXPECT_EQ(uart.serial().type, PORT_16550A);
  EXPECT_EQ(uart.serial().xmit_fifo_size, 16);
  EXPECT_EQ(uart.serial().baud_base, 115200);
  EXPECT_EQ(uart.serial().flags, static_cast<int>(ASYNC_LOW_LATENCY));
  EXPECT_EQ(uart.serial().custom_divisor, 24);
  EXPECT_EQ(uart.serial().close_delay, 51);
  EXPECT_EQ(uart.serial().closing_wait, 52);
}

TEST(UartModelValue, NobodyMovesItsMemory) {
  const serial_struct now = UartModel().serial();
  serial_struct wanted = now;
  wanted.iomem_base = reinterpret_cast<unsigned char*>(std::uintptr_t{16});
  EXPECT_FALSE(UartModel::may_anybody(now, wanted));
}

// setserial(8): what 38400 baud stand for.
TEST(UartModelValue, ARateOfItsOwnStandsFor38400) {
  for (const auto& [flags, rate] : {std::pair(0U, 38400U),
                                    {ASYNC_SPD_HI, 57600U},
                                    {ASYNC_SPD_VHI, 115200U},
                                    {ASYNC_SPD_SHI, 230400U},
                                    {ASYNC_SPD_WARP, 460800U},
                                    {ASYNC_SPD_CUST, 4800U},
                                    {ASYNC_SPD_CUST | ASYNC_LOW_LATENCY, 4800U},
                                    {ASYNC_LOW_LATENCY, 38400U}}) {
    UartModel uart;
    serial_struct wanted{};
    wanted.flags = static_cast<int>(flags);
    wanted.custom_divisor = 24;
    uart.make(wanted);
    EXPECT_EQ(uart.rate_of(38400), rate) << flags;
    EXPECT_EQ(uart.rate_of(9600), 9600U);
    EXPECT_EQ(uart.rate_of(38401), 38401U);
  }
}

TEST(UartModelValue, WithoutADivisorTheRateIsItself) {
  UartModel uart;
  serial_struct wanted{};
  wanted.flags = static_cast<int>(ASYNC_SPD_CUST);
  uart.make(wanted);
  EXPECT_EQ(uart.rate_of(38400), 38400U);
  wanted.custom_divisor = 1;
  uart.make(wanted);
  EXPECT_EQ(uart.rate_of(38400), 115200U);
}

// serial_struct of <linux/serial.h> as a program of 32 bits has it: the pointer has four bytes.
constexpr std::size_t kSmallSize = 60;
constexpr std::size_t kIomemBaseAt = 44;
constexpr std::size_t kIomemRegShiftAt = 48;
constexpr std::size_t kPortHighAt = 52;

template <class T>
T at(const std::array<std::byte, kSmallSize + 4>& bytes, std::size_t offset) {
  T value{};
  std::memcpy(&value, bytes.data() + offset, sizeof(value));
  return value;
}

serial_struct some_serial(std::uintptr_t base) {
  serial_struct serial{};
  serial.type = 4;
  serial.line = 1;
  serial.custom_divisor = 24;
  serial.closing_wait = 3000;
  serial.closing_wait2 = 7;
  serial.iomem_base = reinterpret_cast<unsigned char*>(base);
  serial.iomem_reg_shift = 2;
  serial.port_high = 9;
  return serial;
}

#if defined(__x86_64__)
TEST(UartModelValue, AProgramOf32BitsGetsItsOwnForm) {
  const OwnCall own(AUDIT_ARCH_I386);
  const Call& call = own.seen();
  ASSERT_TRUE(call.is_small());
  for (const auto& [base, shown] : {std::pair<std::uintptr_t, std::uint32_t>(0xfeed0000, 0xfeed0000),
                                    {0xffffffff, 0xffffffff},
                                    {0x100000000, 0xfffffff},
                                    {0x7f0000000000, 0xfffffff}}) {
    std::array<std::byte, kSmallSize + 4> bytes{};
    bytes.fill(std::byte{0xa5});
    if (!write_serial(call, address_of(bytes.data()), some_serial(base)))
      GTEST_SKIP() << "this process may not be written to by itself here";
    EXPECT_EQ(at<int>(bytes, 0), 4);
    EXPECT_EQ(at<std::uint16_t>(bytes, 40), 3000);
    EXPECT_EQ(at<std::uint16_t>(bytes, 42), 7);
    EXPECT_EQ(at<std::uint32_t>(bytes, kIomemBaseAt), shown) << base;
    EXPECT_EQ(at<std::uint16_t>(bytes, kIomemRegShiftAt), 2);
    EXPECT_EQ(at<std::uint32_t>(bytes, kPortHighAt), 9U);
    EXPECT_EQ(at<std::uint32_t>(bytes, kSmallSize), 0xa5a5a5a5) << "what is behind it is not ours";
    const std::optional<serial_struct> read = read_serial(call, address_of(bytes.data()));
    ASSERT_TRUE(read.has_value());
    EXPECT_EQ(read->type, 4);
    EXPECT_EQ(read->closing_wait2, 7);
    EXPECT_EQ(read->custom_divisor, 24);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(read->iomem_base), shown);
    EXPECT_EQ(read->iomem_reg_shift, 2);
    EXPECT_EQ(read->port_high, 9U);
  }
  EXPECT_FALSE(read_serial(call, 8).has_value());
  EXPECT_FALSE(write_serial(call, 8, some_serial(0)));
}
#endif

TEST(UartModelValue, AnotherProgramGetsItAsItIs) {
  const OwnCall own;
  const Call& call = own.seen();
  ASSERT_FALSE(call.is_small());
  serial_struct got{};
  if (!write_serial(call, address_of(&got), some_serial(0x7f0000000000)))
    GTEST_SKIP() << "this process may not be written to by itself here";
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(got.iomem_base), 0x7f0000000000U);
  EXPECT_EQ(got.port_high, 9U);
  const std::optional<serial_struct> read = read_serial(call, address_of(&got));
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(read->custom_divisor, 24);
  EXPECT_FALSE(read_serial(call, 8).has_value());
}

}  // namespace
}  // namespace porttape
