// tap_calls CHECK PORT: what a driver does with its own device, which sends back what it gets. Exits 0 where the
// kernel's calls did what they should.
//   race      a second thread changes what is being written; the last line is what the wire had (hex)
//   reads     VMIN, VTIME, O_NONBLOCK, select, canonical, readv and writev
//   copies    dup, dup2 to stdin and stdout, a child that has it alone
//   reopen    closes and opens at once, 20 times
//   signals   160 kB under a signal every 0.3 ms; a read that one ends, and one that it does not
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define CHECK(what) \
  do { if (!(what)) { fprintf(stderr, "tap_calls.c:%d: %s: %s\n", __LINE__, #what, strerror(errno)); exit(1); } } while (0)

static int open_line(const char* path, int flags, int vmin, int vtime) {
  const int fd = open(path, O_RDWR | O_NOCTTY | flags);
  struct termios tio;
  CHECK(fd >= 0);
  CHECK(tcgetattr(fd, &tio) == 0);
  cfmakeraw(&tio);
  tio.c_cc[VMIN] = (cc_t)vmin;
  tio.c_cc[VTIME] = (cc_t)vtime;
  CHECK(tcsetattr(fd, TCSANOW, &tio) == 0);
  return fd;
}

static void set_reads(int fd, int vmin, int vtime) {
  struct termios tio;
  CHECK(tcgetattr(fd, &tio) == 0);
  tio.c_cc[VMIN] = (cc_t)vmin;
  tio.c_cc[VTIME] = (cc_t)vtime;
  CHECK(tcsetattr(fd, TCSANOW, &tio) == 0);
}

static double now(void) {
  struct timespec at;
  clock_gettime(CLOCK_MONOTONIC, &at);
  return (double)at.tv_sec + (double)at.tv_nsec / 1e9;
}

static void read_all(int fd, char* into, size_t size) {
  while (size > 0) {
    const ssize_t got = read(fd, into, size);
    if (got < 0 && errno == EINTR) continue;
    CHECK(got > 0);
    into += got;
    size -= (size_t)got;
  }
}

static volatile char racing[8] = "aaaaaaa";
static volatile int race_over = 0;
static void* change(void* unused) {
  while (!race_over)
    for (int i = 0; i < 8; ++i) racing[i] = (char)('a' + (racing[i] - 'a' + 1) % 26);
  return unused;
}

static void check_race(const char* path) {
  const int fd = open_line(path, 0, 1, 0);
  pthread_t thread;
  CHECK(pthread_create(&thread, NULL, change, NULL) == 0);
  for (int i = 0; i < 5000; ++i) {
    char back[8];
    CHECK(write(fd, (const void*)racing, 8) == 8);
    read_all(fd, back, 8);
    fwrite(back, 1, 8, stdout);
  }
  race_over = 1;
  pthread_join(thread, NULL);
}

static volatile uintptr_t wrong = 1;

static void check_reads(const char* path) {
  const int fd = open_line(path, 0, 1, 0);
  char back[64];
  CHECK(write(fd, "abcdef", 6) == 6);
  CHECK(read(fd, back, 3) == 3 && memcmp(back, "abc", 3) == 0);
  read_all(fd, back, 3);

  set_reads(fd, 5, 0);  // waits for five
  CHECK(write(fd, "ab", 2) == 2);
  double before = now();
  const pid_t child = fork();
  CHECK(child >= 0);
  if (child == 0) {
    usleep(50000);
    CHECK(write(fd, "cdefg", 5) == 5);
    _exit(0);
  }
  const ssize_t size = read(fd, back, sizeof back);
  CHECK(size >= 5 && now() - before >= 0.04);
  CHECK(waitpid(child, NULL, 0) == child);
  set_reads(fd, 1, 0);
  if (size < 7) read_all(fd, back + size, (size_t)(7 - size));
  CHECK(memcmp(back, "abcdefg", 7) == 0);

  set_reads(fd, 0, 2);  // 0.2 s for the first
  before = now();
  CHECK(read(fd, back, 10) == 0);
  CHECK(now() - before >= 0.19 && now() - before < 60);
  set_reads(fd, 0, 255);  // 25.5 s for the first
  CHECK(write(fd, "x", 1) == 1);
  CHECK(read(fd, back, 10) == 1 && back[0] == 'x');

  set_reads(fd, 10, 1);  // 0.1 s between two
  CHECK(write(fd, "12", 2) == 2);
  CHECK(read(fd, back, 10) == 2 && memcmp(back, "12", 2) == 0);

  set_reads(fd, 0, 0);  // what is there
  CHECK(read(fd, back, 10) == 0);

  set_reads(fd, 1, 0);
  CHECK(fcntl(fd, F_SETFL, O_NONBLOCK) == 0);
  CHECK(read(fd, back, 10) == -1 && errno == EAGAIN);
  CHECK((fcntl(fd, F_GETFL) & O_NONBLOCK) != 0);
  struct iovec out[2] = {{"he", 2}, {"llo", 3}};
  CHECK(writev(fd, out, 2) == 5);
  fd_set set;
  FD_ZERO(&set);
  FD_SET(fd, &set);
  struct timeval limit = {60, 0};
  CHECK(select(fd + 1, &set, NULL, NULL, &limit) == 1);
  CHECK(fcntl(fd, F_SETFL, 0) == 0);
  char first[2];
  char second[3];
  struct iovec in[2] = {{first, 2}, {second, 3}};
  size_t got = 0;
  while (got < 5) {
    struct pollfd ready = {fd, POLLIN, 0};
    CHECK(poll(&ready, 1, 120000) == 1);
    const ssize_t more = got == 0 ? readv(fd, in, 2) : read(fd, second + got - 2, 5 - got);
    CHECK(more > 0);
    got += (size_t)more;
    if (got < 2) break;
  }
  CHECK(got == 5 && memcmp(first, "he", 2) == 0 && memcmp(second, "llo", 3) == 0);
  CHECK(read(fd, NULL, 0) == 0);
  CHECK(write(fd, (void*)(uintptr_t)wrong, 4) == -1 && errno == EFAULT);
  CHECK(read(fd + 1, back, 1) == -1 && errno == EBADF);

  struct termios tio;
  CHECK(tcgetattr(fd, &tio) == 0);
  tio.c_lflag |= ICANON;
  CHECK(tcsetattr(fd, TCSANOW, &tio) == 0);
  CHECK(write(fd, "line\nnext\n", 10) == 10);
  CHECK(read(fd, back, sizeof back) == 5 && memcmp(back, "line\n", 5) == 0);
  CHECK(read(fd, back, sizeof back) == 5 && memcmp(back, "next\n", 5) == 0);
}

static void check_copies(const char* path) {
  const int fd = open_line(path, 0, 1, 0);
  char back[8];
  const int copy = dup(fd);
  CHECK(copy >= 0);
  CHECK(write(copy, "dup", 3) == 3);
  read_all(copy, back, 3);
  const int other = fcntl(fd, F_DUPFD_CLOEXEC, 3);
  CHECK(other >= 0 && (fcntl(other, F_GETFD) & FD_CLOEXEC) != 0);
  CHECK(write(other, "fcn", 3) == 3);
  read_all(other, back, 3);
  CHECK(close(copy) == 0 && close(other) == 0);
  const pid_t child = fork();
  CHECK(child >= 0);
  if (child == 0) {
    CHECK(dup2(fd, 0) == 0 && dup2(fd, 1) == 1 && close(fd) == 0);
    execlp("sh", "sh", "-c", "printf 'by sh\\n'; read answer; test \"$answer\" = 'by sh'", (char*)NULL);
    _exit(9);
  }
  CHECK(close(fd) == 0);
  int status = 0;
  CHECK(waitpid(child, &status, 0) == child && status == 0);
}

static void check_reopen(const char* path) {
  for (int i = 0; i < 20; ++i) {
    const int fd = open_line(path, 0, 1, 0);
    char back[2];
    CHECK(write(fd, "re", 2) == 2);
    read_all(fd, back, 2);
    CHECK(close(fd) == 0);
  }
}

static volatile sig_atomic_t alarms = 0;
static void on_alarm(int number) { alarms += number == SIGALRM; }

static void alarm_every(int us, int flags) {
  struct sigaction action;
  memset(&action, 0, sizeof action);
  action.sa_handler = on_alarm;
  action.sa_flags = flags;
  CHECK(sigaction(SIGALRM, &action, NULL) == 0);
  const struct itimerval timer = {{us / 1000000, us % 1000000}, {us / 1000000, us % 1000000}};
  CHECK(setitimer(ITIMER_REAL, &timer, NULL) == 0);
}

static void check_signals(const char* path) {
  const int fd = open_line(path, 0, 1, 0);
  char back[16];
  double before = now();
  alarm_every(200000, 0);
  CHECK(read(fd, back, 1) == -1 && errno == EINTR);
  CHECK(now() - before >= 0.19);
  fprintf(stderr, "tap_calls: EINTR after %.1f ms\n", (now() - before) * 1e3);

  const int so_far = alarms;
  alarm_every(50000, SA_RESTART);
  const pid_t child = fork();
  CHECK(child >= 0);
  if (child == 0) {
    usleep(300000);
    CHECK(write(fd, "!", 1) == 1);
    _exit(0);
  }
  CHECK(read(fd, back, 1) == 1 && back[0] == '!');
  CHECK(alarms > so_far);
  alarm_every(0, 0);
  CHECK(waitpid(child, NULL, 0) == child);

  alarm_every(333, 0);
  for (int i = 0; i < 10000; ++i) {
    char text[17];
    snprintf(text, sizeof text, "%015d\n", i);
    for (size_t sent = 0; sent < 16;) {
      const ssize_t size = write(fd, text + sent, 16 - sent);
      CHECK(size > 0 || (size < 0 && errno == EINTR));
      if (size > 0) sent += (size_t)size;
    }
    read_all(fd, back, 16);
    CHECK(memcmp(back, text, 16) == 0);
  }
  alarm_every(0, 0);
  fprintf(stderr, "tap_calls: 160000 bytes, 0 lost, %d signals\n", (int)alarms);
}

int main(int count, char** words) {
  if (count < 3) return 2;
  if (strcmp(words[1], "race") == 0) check_race(words[2]);
  else if (strcmp(words[1], "reads") == 0) check_reads(words[2]);
  else if (strcmp(words[1], "copies") == 0) check_copies(words[2]);
  else if (strcmp(words[1], "reopen") == 0) check_reopen(words[2]);
  else if (strcmp(words[1], "signals") == 0) check_signals(words[2]);
  else return 2;
  return 0;
}
