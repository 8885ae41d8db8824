// A program of flexiport's with one thread that reads and one that writes.

#include <atomic>
#include <fcntl.h>
#include <flexiport/flexiport.h>
#include <flexiport/logfile.h>
#include <flexiport/port.h>
#include <functional>
#include <memory>
#include <poll.h>
#include <string>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace {

constexpr int kPatience = 60'000;  // ms, for what must come
constexpr int kLines = 2000;

std::string numbered_line(int number) { return "line " + std::to_string(number) + "\n"; }

std::string all_lines() {
  std::string text;
  for (int number = 0; number < kLines; ++number) text += numbered_line(number);
  return text;
}

// A device that sends back what it gets, until so many bytes have passed.
void echo(int fd, std::size_t count) {
  char piece[4096];
  while (count > 0) {
    pollfd readable{fd, POLLIN, 0};
    if (::poll(&readable, 1, kPatience) != 1) return;
    const ssize_t got = ::read(fd, piece, sizeof piece);
    for (ssize_t sent = 0; sent < got;) {
      pollfd writable{fd, POLLOUT, 0};
      if (::poll(&writable, 1, kPatience) != 1) return;
      const ssize_t size = ::write(fd, piece + sent, static_cast<std::size_t>(got - sent));
      if (size > 0) sent += size;
    }
    if (got > 0) count -= static_cast<std::size_t>(got);
  }
}

class FlexiportThreads : public testing::Test {
 protected:
  FlexiportThreads() {
    ::grantpt(device_.get());
    ::unlockpt(device_.get());
  }
  void open(const std::string& options) {
    port_.reset(flexiport::CreatePort(options + ",timeout=30,device=" + ::ptsname(device_.get())));
    port_->Open();
  }
  // Writes lines in this thread and reads their echo in another one.
  std::string write_and_read() {
    std::string read;
    std::thread device([this] { echo(device_.get(), all_lines().size()); });
    std::thread reader([&] {
      std::string line;
      for (int number = 0; number < kLines && port_->ReadLine(line) > 0; ++number) read += line;
    });
    for (int number = 0; number < kLines; ++number) port_->WriteString(numbered_line(number));
    reader.join();
    device.join();
    return read;
  }

  porttape::UniqueFd device_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)};
  std::unique_ptr<flexiport::Port> port_;
};

TEST_F(FlexiportThreads, OneReadsWhileTheOtherWrites) {
  open("type=serial");
  EXPECT_TRUE(write_and_read() == all_lines());
  port_->Close();
  EXPECT_FALSE(port_->IsOpen());
}

TEST_F(FlexiportThreads, AThirdOneMayAskAndSet) {
  open("type=serial");
  std::atomic<bool> over = false;
  std::thread third([&] {
    while (!over) {
      port_->SetTimeout(flexiport::Timeout(30, 0));
      port_->SetCanRead(port_->CanRead());
      EXPECT_EQ(port_->GetTimeout()._sec, 30);
      EXPECT_TRUE(port_->IsOpen() && port_->IsBlocking());
      EXPECT_NE(port_->GetStatus().find("State: open"), std::string::npos);
    }
  });
  EXPECT_TRUE(write_and_read() == all_lines());
  over = true;
  third.join();
}

TEST_F(FlexiportThreads, TheirLogHasBothDirections) {
  const porttape::test::TempDir dir;
  open("type=seriallog,file=" + (dir / "t.log"));
  EXPECT_TRUE(write_and_read() == all_lines());
  port_->Close();
  port_.reset();

  const std::string lines = all_lines();
  flexiport::LogFile log(0);
  log.Open(dir / "t.log", true, true);
  std::string read(lines.size() + 1, '?');
  flexiport::Timeout at_once(0, 0);
  ssize_t got = 0;
  for (ssize_t size = 1; size > 0; got += size)
    size = log.Read(read.data() + got, read.size() - static_cast<std::size_t>(got), at_once);
  read.resize(static_cast<std::size_t>(got));
  EXPECT_TRUE(read == lines);
  size_t right = 0;
  EXPECT_TRUE(log.CheckWrite(lines.data(), lines.size(), &right));
  EXPECT_EQ(right, lines.size());
}

TEST_F(FlexiportThreads, ACloseEndsAReadThatWaits) {
  open("type=serial");
  std::atomic<bool> reads = false;
  ssize_t size = -2;
  std::thread reader([&] {
    char byte = 0;
    reads = true;
    try {
      size = port_->ReadFull(&byte, 1);
    } catch (const flexiport::PortException& error) {  // it was closed before the call
      EXPECT_NE(std::string(error.what()).find("not open"), std::string::npos);
      size = 0;
    }
  });
  while (!reads) std::this_thread::yield();
  port_->Close();
  reader.join();
  EXPECT_EQ(size, 0);
}

}  // namespace
