// What a call tells of its program, which is this one.

#include "libport/supervise/call.hpp"

#include <array>
#include <cerrno>
#include <climits>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <fcntl.h>
#include <linux/audit.h>
#include <optional>
#include <string>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "tests/supervise/own_call.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

using test::address_of;
using test::holds_without;
using test::OwnCall;

// Two pages, of which the second cannot be reached.
class Pages {
 public:
  explicit Pages(int rights = PROT_READ | PROT_WRITE)
      : size_(static_cast<std::size_t>(::sysconf(_SC_PAGESIZE))),
        begin_(static_cast<std::byte*>(
            ::mmap(nullptr, 2 * size_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0))) {
    ::memset(begin_, 'p', size_);
    ::mprotect(begin_, size_, rights);
    ::mprotect(begin_ + size_, size_, PROT_NONE);
  }
  ~Pages() { ::munmap(begin_, 2 * size_); }
  Pages(const Pages&) = delete;
  Pages& operator=(const Pages&) = delete;
  [[nodiscard]] std::byte* before_end(std::size_t bytes) const { return begin_ + size_ - bytes; }

 private:
  std::size_t size_;
  std::byte* begin_;
};

TEST(Call, WhatTheKernelToldIsKept) {
  const OwnCall own;
  EXPECT_EQ(own.call->id(), 17U);
  EXPECT_EQ(own.call->thread(), ::gettid());
  EXPECT_EQ(own.call->number(), SYS_ioctl);
  EXPECT_FALSE(own.call->is_small());
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(own.call->argument(i), i + 1);
  EXPECT_FALSE(own.call->waits());
}

TEST(Call, MemoryIsReachedWholeOrNotAtAll) {
  const OwnCall own;
  const Call& call = own.seen();
  const Pages pages;
  std::array<std::byte, 8> got{};
  EXPECT_TRUE(call.read(address_of(pages.before_end(8)), got));
  EXPECT_EQ(got.front(), std::byte{'p'});
  EXPECT_EQ(got.back(), std::byte{'p'});
  EXPECT_FALSE(call.read(address_of(pages.before_end(7)), got));
  EXPECT_FALSE(call.read(8, got));
  const std::array<std::byte, 4> what{std::byte{'a'}, std::byte{'b'}, std::byte{'c'}, std::byte{'d'}};
  EXPECT_TRUE(call.write(address_of(pages.before_end(4)), what));
  EXPECT_EQ(std::memcmp(pages.before_end(4), what.data(), what.size()), 0);
  EXPECT_FALSE(call.write(address_of(pages.before_end(3)), what));
  const Pages to_read(PROT_READ);
  EXPECT_TRUE(call.read(address_of(to_read.before_end(8)), got));
  EXPECT_FALSE(call.write(address_of(to_read.before_end(8)), what));
  const Pages closed(PROT_NONE);
  EXPECT_FALSE(call.read(address_of(closed.before_end(8)), got));
}

// A container's filter forbids them, or a kernel lacks them. /proc/PID/mem reaches more than the program may.
TEST(Call, WithoutCallsForItMemoryIsReachedByProc) {
  for (const int error : {EPERM, ENOSYS}) {
    EXPECT_TRUE(holds_without({{SYS_process_vm_readv, error}}, [] {
      const OwnCall own;
      const Call& call = own.seen();
      const Pages pages;
      const Pages closed(PROT_NONE);
      std::array<std::byte, 8> got{};
      EXPECT_TRUE(call.read(address_of(pages.before_end(8)), got));
      EXPECT_EQ(got.back(), std::byte{'p'});
      EXPECT_FALSE(call.read(address_of(pages.before_end(7)), got));
      EXPECT_FALSE(call.read(address_of(closed.before_end(8)), got));
      EXPECT_FALSE(call.read(8, got));
    }));
  }
  EXPECT_TRUE(holds_without({{SYS_process_vm_readv, EFAULT}}, [] {
    const OwnCall own;
    std::array<std::byte, 8> got{};
    EXPECT_FALSE(own.seen().read(address_of(Pages().before_end(8)), got)) << "that is an answer";
  }));
}

// It is written where the call still waits, and this one does not.
TEST(Call, NothingIsWrittenForOneThatIsOver) {
  const std::array<std::byte, 2> what{std::byte{'a'}, std::byte{'b'}};
  std::array<std::byte, 2> into{};
  const OwnCall own;
  EXPECT_FALSE(own.call->write(address_of(into.data()), what)) << "it has not been seen";
  const Call later = own.seen().for_later();
  EXPECT_TRUE(own.call->write(address_of(into.data()), what));
  EXPECT_FALSE(later.write(address_of(into.data()), what));
  EXPECT_TRUE(holds_without({{SYS_process_vm_writev, EPERM}}, [&] {
    OwnCall other;
    EXPECT_FALSE(other.seen().write(address_of(into.data()), what));
  }));
}

TEST(Call, APathIsReadUpToItsEnd) {
  const OwnCall own;
  const Call& call = own.seen();
  const auto path_of = [&](const char* text) { return call.read_path(address_of(text)); };
  EXPECT_EQ(path_of("/dev/ttyUSB0"), "/dev/ttyUSB0");
  EXPECT_EQ(path_of(""), "");
  const std::string longest(PATH_MAX - 1, 'x');
  EXPECT_EQ(path_of(longest.c_str()), longest);
  EXPECT_FALSE(path_of(std::string(PATH_MAX, 'x').c_str()).has_value());
  EXPECT_EQ(path_of(std::string(255, 'x').c_str()), std::string(255, 'x'));
  EXPECT_EQ(path_of(std::string(256, 'x').c_str()), std::string(256, 'x'));
  EXPECT_FALSE(call.read_path(8).has_value());
}

// The page behind it may not be there.
TEST(Call, APathMayEndWithItsPage) {
  const OwnCall own;
  const Pages pages;
  std::byte* const begin = pages.before_end(5);
  std::memcpy(begin, "/dev", 5);
  EXPECT_EQ(own.seen().read_path(address_of(begin)), "/dev");
  std::memcpy(begin, "/dev/", 5);
  EXPECT_FALSE(own.seen().read_path(address_of(begin)).has_value());
}

TEST(Call, ADescriptorIsOfTheSameOpenFile) {
  const OwnCall own;
  const UniqueFd file(::open("/dev/null", O_RDWR | O_CLOEXEC));
  const UniqueFd other(::open("/dev/null", O_RDWR | O_CLOEXEC));
  const UniqueFd same = own.call->duplicate(file.get());
  ASSERT_TRUE(same);
  EXPECT_NE(same.get(), file.get());
  ASSERT_EQ(::fcntl(file.get(), F_SETFL, O_NONBLOCK), 0);
  EXPECT_NE(::fcntl(same.get(), F_GETFL) & O_NONBLOCK, 0);
  EXPECT_TRUE(own.call->has_as(file.get(), same.get()));
  EXPECT_FALSE(own.call->has_as(other.get(), same.get()));
  EXPECT_FALSE(own.call->duplicate(INT_MAX));
  EXPECT_TRUE(own.call->device_of(file.get()).has_value());
  EXPECT_FALSE(own.call->device_of(INT_MAX).has_value());
}

// What is got by a number counts only while its call waits.
TEST(Call, OfAThreadThatIsNotKnownAndDoesNotWaitNothingIsHad) {
  const OwnCall own(AUDIT_ARCH_X86_64, false);
  const UniqueFd file(::open("/dev/null", O_RDWR | O_CLOEXEC));
  EXPECT_FALSE(own.call->duplicate(file.get()));
  EXPECT_EQ(own.threads.find(::gettid()), -1);
}

TEST(Call, WithoutADuplicateADeviceIsLookedUpInProc) {
  EXPECT_TRUE(holds_without({{SYS_pidfd_getfd, EPERM}}, [] {
    const OwnCall own;
    const UniqueFd file(::open("/dev/null", O_RDWR | O_CLOEXEC));
    const UniqueFd place(::open("/dev/null", O_PATH | O_CLOEXEC));
    const UniqueFd folder(::open("/", O_RDONLY | O_CLOEXEC));
    const std::optional<TtyDevice> device = own.call->device_of(file.get());
    ASSERT_TRUE(device.has_value());
    EXPECT_EQ(device->number, tty_device_of(file.get())->number);
    EXPECT_FALSE(own.call->device_of(place.get()).has_value()) << "who has it may not use the device";
    EXPECT_FALSE(own.call->device_of(folder.get()).has_value());
    EXPECT_FALSE(own.call->device_of(INT_MAX).has_value());
  }));
}

TEST(Call, AProgramThatShowsNothingIsClosed) {
  EXPECT_FALSE(OwnCall().call->is_closed());
  for (const int error : {EACCES, EPERM}) {
    EXPECT_TRUE(holds_without({test::refused_open(O_CLOEXEC, error)},
                              [] { EXPECT_TRUE(OwnCall().call->is_closed()); }));
  }
  EXPECT_TRUE(holds_without({test::refused_open(O_CLOEXEC, ENOENT)},
                            [] { EXPECT_FALSE(OwnCall().call->is_closed()); }));
}

}  // namespace
}  // namespace porttape
