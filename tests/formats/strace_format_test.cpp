#include "libport/formats/strace_format.hpp"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/formats/strace_line.hpp"
#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::imported;
using testing::ElementsAre;
using testing::HasSubstr;

class StraceFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> import(const std::string& log, std::optional<std::string> device = {}) {
    return imported(dir, "t" + std::to_string(++made_), "strace", log,
                    {.swapped = false, .lead = {}, .bytes_at = {}, .device = std::move(device)});
  }
  std::vector<std::string> lines(const std::string& log, std::optional<std::string> device = {}) {
    std::vector<std::string> all;
    for (const std::string& line : test::lines_of(import(log, std::move(device)))) {
      if (line.find("\"convert: ") == std::string::npos) all.push_back(line);
    }
    return all;
  }

  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(StraceFormatTest, BytesSettingsFlushesAndLinesOfADriver) {
  EXPECT_THAT(
      lines(R"(7 1700000100.000000 openat(AT_FDCWD, "/dev/ttyUSB0", O_RDWR|O_NOCTTY) = 3 <0.000020>
7 1700000100.000100 ioctl(3, SNDCTL_TMR_START or TCSETS, {c_iflag=IXON|IXOFF, c_oflag=0, c_cflag=B19200|CS7|CREAD|PARENB|PARODD|CSTOPB|CRTSCTS, c_lflag=0, ...}) = 0 <0.000010>
7 1700000100.000150 ioctl(3, TCSETSF, {c_iflag=IXON|IXOFF, c_cflag=B19200|CS7|CREAD|PARENB|PARODD|CSTOPB|CRTSCTS, ...}) = 0 <0.000010>
7 1700000100.000200 ioctl(3, TCFLSH, TCIOFLUSH) = 0 <0.000010>
7 1700000100.000300 ioctl(3, TIOCMBIC, [TIOCM_DTR|TIOCM_RTS]) = 0 <0.000010>
7 1700000100.000400 ioctl(3, TIOCMBIS, [TIOCM_DTR]) = -1 EIO (Input/output error) <0.000010>
7 1700000100.001000 write(3, "A\33\x00\"\n", 5) = 4 <0.000010>
7 1700000100.002000 ioctl(3, TCSBRK, 1)         = 0 <0.000500>
7 1700000100.003000 read(3, "\x6f\x6b", 100) = 2 <0.004000>
7 1700000100.008000 read(3, 0x7ffc, 100) = -1 EAGAIN (Resource temporarily unavailable) <0.000010>
7 1700000100.009000 ioctl(3, TCSBRK, 0) = 0 <0.250000>
7 1700000100.300000 close(3) = 0 <0.000010>
7 1700000100.300500 +++ exited with 0 +++
)"),
      ElementsAre(
          R"({"t_us":0,"event":"open"})",
          R"({"t_us":100,"event":"settings","by":"driver","baud":19200,"databits":7,"parity":"odd","stopbits":2,"hwflowctrl":true,"swflowctrl":true,"order":"exact"})",
          R"({"t_us":150,"event":"flush","queue":"in"})", R"({"t_us":200,"event":"flush","queue":"both"})",
          R"({"t_us":300,"event":"modem","line":"dtr","state":"off","by":"driver"})",
          R"({"t_us":300,"event":"modem","line":"rts","state":"off","by":"driver"})", HasSubstr("1000"),
          R"({"t_us":2500,"event":"drain","took_us":500})", HasSubstr("7000"),
          R"({"t_us":9000,"event":"break","state":"on","by":"driver"})",
          R"({"t_us":259000,"event":"break","state":"off","by":"driver"})",
          R"({"t_us":300000,"event":"close"})"));
}

TEST_F(StraceFormatTest, CallsThatOthersInterruptAreOne) {
  EXPECT_THAT(lines(R"([pid 7] 1700000100.000000 openat(AT_FDCWD, "/dev/ttyS4", O_RDWR) = 3
[pid 7] 1700000100.000100 clone(child_stack=0x7f, flags=CLONE_VM|CLONE_FS|CLONE_FILES|CLONE_THREAD) = 8
[pid 8] 1700000100.000200 read(3,  <unfinished ...>
[pid 7] 1700000100.000300 write(3, "ask", 3 <unfinished ...>
[pid 8] 1700000100.000500 <... read resumed>"yes", 10) = 3
[pid 7] 1700000100.000600 <... write resumed>) = 3
[pid 7] 1700000100.000700 exit_group(0) = ?
[pid 8] 1700000100.000800 +++ exited with 0 +++
[pid 7] 1700000100.000900 +++ exited with 0 +++
)"),
              ElementsAre(HasSubstr("open"), "w 500 ask", "r 500 yes", HasSubstr("close")));
}

TEST_F(StraceFormatTest, ATtyIsFoundByWhatIsAskedOfItAndItsCopiesAreFollowed) {
  EXPECT_THAT(lines(R"(1700000100.0 openat(AT_FDCWD, "/dev/tty", O_RDWR) = 3
1700000100.1 ioctl(3, TCGETS, {c_cflag=B38400|CS8|CREAD, ...}) = 0
1700000100.2 openat(AT_FDCWD, "/etc/driver.conf", O_RDONLY) = 4
1700000100.3 read(4, "port=/tmp/laser", 4096) = 15
1700000100.4 close(4) = 0
1700000100.5 openat(AT_FDCWD, "/tmp/laser", O_RDWR|O_NOCTTY) = 4
1700000100.6 write(4, "early", 5) = 5
1700000100.7 ioctl(4, TCGETS, {c_cflag=B38400|CS8|CREAD, ...}) = 0
1700000100.8 fcntl(4, F_DUPFD_CLOEXEC, 10) = 10
1700000100.9 close(4) = 0
1700000101.0 write(10, "late", 4) = 4
1700000101.1 fork() = 9
1700000101.2 close(10) = 0
9 1700000101.3 close(10) = 0
1700000101.4 openat(AT_FDCWD, "/tmp/laser", O_RDWR) = 4
1700000101.5 execve("/bin/true", ["true"], 0x7f) = 0
)"),
              ElementsAre(R"({"t_us":0,"event":"open"})", HasSubstr("100000"), HasSubstr("500000"),
                          R"({"t_us":800000,"event":"close"})", R"({"t_us":900000,"event":"open"})"));
}

TEST_F(StraceFormatTest, AnotherDeviceIsNamed) {
  const std::string log = R"(1.0 openat(AT_FDCWD, "/dev/ttyS1", O_RDWR) = 3
1.1 openat(AT_FDCWD, "/dev/ttyS2", O_RDWR) = 4
1.2 write(3, "a", 1) = 1
1.3 write(4, "bc", 2) = 2
1.4 write(0<\x2f\x64\x65\x76\x2f\x70\x74\x73\x2f\x39<char 136:9>>, "def", 3) = 3
1.5 socket(AF_INET, SOCK_STREAM, IPPROTO_TCP) = 5
1.6 connect(5, {sa_family=AF_INET, sin_port=htons(502), sin_addr=inet_addr("10.0.0.7")}, 16) = 0
1.7 sendto(5, "net", 3, MSG_NOSIGNAL, NULL, 0) = 3
1.8 recvfrom(5, "answer", 260, 0, NULL, NULL) = 6
)";
  EXPECT_EQ(import(log)->blocks, 1U);
  EXPECT_THAT(lines(log, "/dev/ttyS2"), ElementsAre(HasSubstr("open"), HasSubstr("bc")));
  EXPECT_THAT(lines(log, "/dev/pts/9"), ElementsAre(HasSubstr("open"), HasSubstr("def")));
  EXPECT_THAT(lines(log, "10.0.0.7:502"),
              ElementsAre(HasSubstr("open"), HasSubstr("net"), HasSubstr("answer")));
  EXPECT_THAT(import(log, "/dev/ttyS3").error().message, HasSubstr("nothing is done with '/dev/ttyS3'"));
}

TEST_F(StraceFormatTest, AConnectionThatIsStillMadeIsOne) {
  const std::string log = R"(12:00:01.0 socket(AF_INET, SOCK_STREAM|SOCK_NONBLOCK, IPPROTO_TCP) = 7
12:00:01.1 connect(7, {sa_family=AF_INET, sin_port=htons(45671), sin_addr=inet_addr("127.0.0.1")}, 16) = -1 EINPROGRESS (Operation now in progress)
12:00:01.2 connect(7, {sa_family=AF_INET, sin_port=htons(45671), sin_addr=inet_addr("127.0.0.1")}, 16) = 0
12:00:01.3 sendto(7, "ask", 3, 0, NULL, 0) = 3
12:00:01.4 recvfrom(7, "yes", 260, 0, NULL, NULL) = 3
12:00:01.5 close(7) = 0
)";
  EXPECT_THAT(lines(log, "127.0.0.1:45671"), ElementsAre(HasSubstr(R"("t_us":0,"event":"open")"),
                                                         "w 200000 ask", "r 300000 yes", HasSubstr("close")));
}

TEST_F(StraceFormatTest, SettingsOfOldVersionsAreTakenAndWhatIsNotKnownIsTold) {
  const std::string log = R"(12:00:01.0 openat(AT_FDCWD, "/dev/ttyS1", O_RDWR) = 3
12:00:01.1 ioctl(3, SNDCTL_TMR_TIMEBASE or TCGETS, {B38400 opost isig icanon echo ...}) = 0
12:00:01.2 ioctl(3, SNDCTL_TMR_START or TCSETS, {B115200 -opost -isig -icanon -echo ...}) = 0
12:00:01.3 ioctl(3, SNDCTL_TMR_START or TCSETS, {B9600 cs7 parenb -parodd cstopb -crtscts ixon ixoff}) = 0
12:00:01.4 ioctl(3, SNDCTL_TMR_START or TCSETS, {c_iflags=0, c_oflags=0x4, c_cflags=0xcb2, c_lflags=0}) = 0
12:00:01.5 ioctl(3, TCSETS2, {c_iflag=0, c_cflag=BOTHER|CS8|CREAD, c_lflag=0, ...}) = 0
12:00:01.6 ioctl(3, SNDCTL_TMR_START or TCSETS, 0x7ffc10) = 0
)";
  EXPECT_THAT(
      lines(log),
      ElementsAre(
          HasSubstr("open"),
          R"({"t_us":200000,"event":"settings","by":"driver","baud":115200,"order":"exact"})",
          R"({"t_us":300000,"event":"settings","by":"driver","baud":9600,"databits":7,"parity":"even","stopbits":2,"hwflowctrl":false,"swflowctrl":true,"order":"exact"})",
          R"({"t_us":500000,"event":"settings","by":"driver","databits":8,"parity":"none","stopbits":1,"hwflowctrl":false,"swflowctrl":false,"order":"exact"})"));
  EXPECT_THAT(import(log)->problems, ElementsAre(HasSubstr("lines 5 and 7: settings are made"),
                                                 HasSubstr("line 6: settings are made and their speed")));
}

TEST_F(StraceFormatTest, WhatIsMissingIsTold) {
  const auto made = import(R"(openat(AT_FDCWD, "/dev/ttyS1", O_RDWR) = 3
what the program prints
write(3, "abc"..., 10) = 10
read(3, "yes", 10) = 3
write(3, "d", 1) = 1
)");
  ASSERT_TRUE(made);
  EXPECT_THAT(made->guesses, ElementsAre(HasSubstr("no times")));
  EXPECT_THAT(made->problems, ElementsAre(HasSubstr("7 bytes are missing, first in line 3"),
                                          HasSubstr("line 2: none of strace's; left out")));
  const auto all = test::lines_on(made->paths);
  ASSERT_EQ(all.size(), 6U);
  EXPECT_THAT(all[2], HasSubstr(R"("event":"gap","bytes":7)"));
  EXPECT_THAT(all[3], HasSubstr("yes"));  // in its place, though there are no times
  EXPECT_THAT(import("1.0 openat(AT_FDCWD, \"/etc/x\", O_RDONLY) = 3\n").error().message,
              HasSubstr("--device PATH"));
}

TEST_F(StraceFormatTest, ClocksOfSecondsKeepTheOrder) {
  const std::string log = R"(12:00:00 openat(AT_FDCWD, "/dev/ttyS1", O_RDWR) = 3
12:00:00 write(3, "A1", 2) = 2
12:00:00 read(3, "a1", 10) = 2
12:00:00 write(3, "B2", 2) = 2
12:00:00 ioctl(3, TCFLSH, TCIFLUSH) = 0
12:00:00 read(3, "b2", 10) = 2
12:00:01 close(3) = 0
)";
  EXPECT_THAT(lines(log), ElementsAre(HasSubstr("open"), "w 0 A1", "r 0 a1", "w 1 B2", HasSubstr("\"flush\""),
                                      "r 2 b2", R"({"t_us":1000000,"event":"close"})"));
  // Durations are finer than such a clock.
  EXPECT_THAT(lines(R"(12:00:00 openat(AT_FDCWD, "/dev/ttyS1", O_RDWR) = 3 <0.000010>
12:00:00 write(3, "A1", 2) = 2 <0.000010>
12:00:00 read(3, "a1", 10) = 2 <0.003000>
12:00:00 write(3, "B2", 2) = 2 <0.000010>
)"),
              ElementsAre(HasSubstr("open"), "w 0 A1", "r 3000 a1", "w 3001 B2"));
}

TEST_F(StraceFormatTest, EveryClockOfStrace) {
  StraceLines day;
  (void)day.read("23:59:59.900000 getpid() = 7");
  EXPECT_EQ(day.read("00:00:00.100000 getpid() = 7").call->begin_us, (24LL * 3600 * 10 + 1) * 100'000);
  StraceLines relative;
  (void)relative.read("     0.000000 getpid() = 7");
  (void)relative.read("     0.000100 getpid() = 7");
  EXPECT_EQ(relative.read("     0.000200 getpid() = 7").call->begin_us, 300);
  StraceLines date;
  EXPECT_EQ(date.read("1700000000.000001 getpid() = 7").call->begin_us, 1'700'000'000'000'001);
  EXPECT_TRUE(date.has_dates());
}

TEST_F(StraceFormatTest, IsKnownByItsLines) {
  EXPECT_GT(detect_strace("1.0 execve(\"/bin/true\", [\"true\"], 0x7f) = 0\n1.1 brk(NULL) = 0x55\n"), 0);
  EXPECT_EQ(detect_strace("main(argc) = 0 is\nno strace\nat all\n"), 0);
}

}  // namespace
}  // namespace porttape
