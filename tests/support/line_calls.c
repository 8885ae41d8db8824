// line_calls.c: a driver of few words, for tests of those who stand between a driver and its line. Plain C,
// so that it is built dynamic, static, and with another libc.
//
//   line_calls WHAT PORT [ARGUMENT…]        status 0 where all is as on a serial port, with a device that
//   sends back
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#ifndef TIOCMIWAIT
#define TIOCMIWAIT 0x545C
#endif
#ifndef TIOCGICOUNT
#define TIOCGICOUNT 0x545D
#endif

static const char* path;

static void fail(const char* format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fputs("line_calls: ", stderr);
  vfprintf(stderr, format, arguments);
  fputc('\n', stderr);
  va_end(arguments);
  exit(1);
}

static void fail_errno(const char* what) { fail("%s: %s (%d)", what, strerror(errno), errno); }

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec + time.tv_nsec * 1e-9;
}

static int open_port(int flags) {
  int fd = open(path, O_RDWR | O_NOCTTY | flags);
  if (fd < 0) fail_errno(path);
  struct termios mode;
  if (tcgetattr(fd, &mode)) fail_errno("tcgetattr");
  cfmakeraw(&mode);
  cfsetspeed(&mode, B115200);
  if (tcsetattr(fd, TCSANOW, &mode)) fail_errno("tcsetattr");
  return fd;
}

static int lines_of(int fd) {
  int lines = 0;
  if (ioctl(fd, TIOCMGET, &lines)) fail_errno("TIOCMGET");
  return lines;
}

static void change(int fd, unsigned long request, int lines) {
  if (ioctl(fd, request, &lines)) fail_errno("TIOCMBIS or TIOCMBIC");
}

static void write_all(int fd, const char* data, size_t size) {
  while (size > 0) {
    ssize_t wrote = write(fd, data, size);
    if (wrote < 0 && errno != EINTR && errno != EAGAIN) fail_errno("write");
    if (wrote < 0 && errno == EAGAIN) poll(&(struct pollfd){fd, POLLOUT, 0}, 1, 1000);
    if (wrote > 0) data += wrote, size -= (size_t)wrote;
  }
}

// Whatever blocks it is ended by a signal that none of these programs catches.
static void read_back(int fd, const char* words) {
  char got[64];
  size_t have = 0, size = strlen(words);
  write_all(fd, words, size);
  while (have < size) {
    if (poll(&(struct pollfd){fd, POLLIN, 0}, 1, 120000) == 0) fail("nothing is sent back within 120 s");
    ssize_t count = read(fd, got + have, size - have);
    if (count == 0) fail("the line was hung up");
    if (count < 0 && errno != EINTR && errno != EAGAIN) fail_errno("read");
    if (count > 0) have += (size_t)count;
  }
  if (memcmp(got, words, size) != 0) fail("sent %s, got %.*s", words, (int)size, got);
}

// The signals are those of --lines loopback: CTS follows RTS, DSR and CD follow DTR; at once, or with
// LINE_CALLS_PATIENT soon.
static void expect(int fd, int lines, const char* why) {
  int mask = TIOCM_RTS | TIOCM_DTR | TIOCM_CTS | TIOCM_DSR | TIOCM_CD;
  int got = lines_of(fd);
  double until = now() + (getenv("LINE_CALLS_PATIENT") ? 60 : 0);
  while ((got & mask) != lines && now() < until) {
    usleep(1000);
    got = lines_of(fd);
  }
  if ((got & mask) != lines) fail("%s: signals 0x%x, expected 0x%x", why, got & mask, lines);
}

enum { rts_side = TIOCM_RTS | TIOCM_CTS, dtr_side = TIOCM_DTR | TIOCM_DSR | TIOCM_CD };

static void try_lines(int fd, const char* why) {
  int all = TIOCM_RTS | TIOCM_DTR;
  if (ioctl(fd, TIOCMSET, &all)) fail_errno("TIOCMSET");
  expect(fd, rts_side | dtr_side, why);
  change(fd, TIOCMBIC, TIOCM_RTS);
  expect(fd, dtr_side, why);
  change(fd, TIOCMBIS, TIOCM_RTS);
  change(fd, TIOCMBIC, TIOCM_DTR);
  expect(fd, rts_side, why);
  change(fd, TIOCMBIS, TIOCM_DTR);
}

static void check_lines(void) {
  int fd = open_port(0);
  try_lines(fd, "lines");
  int counts[20];
  if (ioctl(fd, TIOCGICOUNT, counts)) fail_errno("TIOCGICOUNT");
  if (counts[0] < 2 || counts[1] < 2) fail("%d changes of CTS and %d of DSR counted", counts[0], counts[1]);
  if (tcsendbreak(fd, 0)) fail_errno("tcsendbreak");
  if (ioctl(fd, TIOCSBRK) || ioctl(fd, TIOCCBRK)) fail_errno("TIOCSBRK, TIOCCBRK");
  // A request is 32 bits wide: what is above them is not looked at.
  int lines = 0;
  if (syscall(SYS_ioctl, fd, 0x500000000UL | TIOCMGET, &lines)) fail_errno("TIOCMGET with high bits");
  if (ioctl(fd, TIOCMGET, (void*)8) == 0 || errno != EFAULT)
    fail("TIOCMGET to address 8: %s", strerror(errno));
  if (ioctl(fd, TIOCMSET, NULL) == 0 || errno != EFAULT)
    fail("TIOCMSET from no address: %s", strerror(errno));
  read_back(fd, "lines");
}

static void check_mode(void) {
  static const tcflag_t modes[] = {CS7 | PARENB, CS7 | PARENB | PARODD, CS8 | PARENB, CS8 | PARENB, CS8,
                                   CS5,          CS7 | PARENB};
  for (int times = 0; times < 2; ++times) {
    int fd = open_port(0);
    for (size_t at = 0; at < sizeof modes / sizeof *modes; ++at) {
      struct termios mode;
      tcgetattr(fd, &mode);
      mode.c_cflag = (mode.c_cflag & ~(tcflag_t)(CSIZE | PARENB | PARODD)) | modes[at];
      if (tcsetattr(fd, at % 2 ? TCSADRAIN : TCSANOW, &mode)) fail_errno("tcsetattr");
      if (tcgetattr(fd, &mode)) fail_errno("tcgetattr");
      if ((mode.c_cflag & (CSIZE | PARENB | PARODD)) != modes[at])
        fail("mode %zu is read back as 0%o", at, mode.c_cflag);
    }
    close(fd);
  }
}

static volatile sig_atomic_t alarms;
static void on_alarm(int number) { (void)number, ++alarms; }

static void catch_alarms(int flags) {
  struct sigaction action = {.sa_handler = on_alarm, .sa_flags = flags};
  sigaction(SIGALRM, &action, NULL);
}

static void alarm_every(long microseconds, int once) {
  struct timeval time = {microseconds / 1000000, microseconds % 1000000};
  struct itimerval timer = {once ? (struct timeval){0, 0} : time, time};
  setitimer(ITIMER_REAL, &timer, NULL);
}

// Numbers of four bytes come back, each one behind the last, under 3000 signals a second. Argument: how many
// bytes.
static void check_storm(int count) {
  int fd = open_port(0), interrupted = 0, calls = 0, ended_calls = 0;
  if (fork() == 0) {
    for (unsigned number = 0; number < (unsigned)count / 4; ++number) write_all(fd, (char*)&number, 4);
    _exit(0);
  }
  catch_alarms(0);
  alarm_every(333, 0);
  unsigned expected = 0;
  size_t have = 0;
  char data[4];
  while (expected < (unsigned)count / 4) {
    ssize_t got = read(fd, data + have, 4 - have);
    if (got < 0 && errno == EINTR) {
      ++interrupted;
    } else if (got <= 0) {
      fail_errno("read");
    } else if ((have += (size_t)got) == 4) {
      unsigned number;
      memcpy(&number, data, 4);
      if (number != expected) fail("number %u where %u is due", number, expected);
      ++expected;
      have = 0;
      // A supervisor's kernel lets a signal end also a call that waits for nothing, before it is looked at.
      int lines;
      if (expected % 16 == 0 && (++calls, ioctl(fd, TIOCMGET, &lines))) {
        if (errno != EINTR) fail_errno("TIOCMGET");
        ++ended_calls;
      }
      if (expected % 1024 == 0 && tcdrain(fd) && errno != EINTR) fail_errno("tcdrain");
    }
  }
  alarm_every(0, 0);
  while (waitpid(-1, NULL, 0) < 0 && errno == EINTR) {
  }
  printf("%d bytes, none lost; %d signals, %d of them ended a read, %d one of %d TIOCMGET\n", count,
         (int)alarms, interrupted, ended_calls, calls);
}

// The wait for a change of a signal ends by one that another thread makes, and by a signal of the process.
static int main_thread_sleeps(void) {
  char name[64], state = '?';
  snprintf(name, sizeof name, "/proc/self/task/%d/stat", (int)getpid());
  FILE* file = fopen(name, "r");
  if (!file || fscanf(file, "%*d (%*[^)]) %c", &state) != 1) fail_errno(name);
  fclose(file);
  return state == 'S';
}

static void* drop_rts_later(void* fd) {
  while (!main_thread_sleeps()) usleep(1000);  // it has come to its wait
  usleep(200000);
  change(*(int*)fd, TIOCMBIC, TIOCM_RTS);
  return NULL;
}

static void check_wait(void) {
  int fd = open_port(0);
  change(fd, TIOCMBIS, TIOCM_RTS | TIOCM_DTR);
  expect(fd, rts_side | dtr_side, "before the wait");
  pthread_t other;
  pthread_create(&other, NULL, drop_rts_later, &fd);
  double began = now();
  if (ioctl(fd, TIOCMIWAIT, TIOCM_CTS)) fail_errno("TIOCMIWAIT that a change ends");
  if (now() - began < 0.15) fail("TIOCMIWAIT ended after %.3f s, before the change", now() - began);
  if (lines_of(fd) & TIOCM_CTS) fail("CTS is still on");
  pthread_join(other, NULL);

  catch_alarms(0);
  began = now();
  alarm_every(200000, 0);  // again and again: the first may come before the wait
  if (ioctl(fd, TIOCMIWAIT, TIOCM_CTS | TIOCM_RI) == 0 || errno != EINTR)
    fail("TIOCMIWAIT: not EINTR but %s", strerror(errno));
  alarm_every(0, 0);
  if (now() - began < 0.19 || alarms < 1) fail("EINTR after %.3f s, %d signals", now() - began, (int)alarms);
  printf("EINTR %.1f ms after the signal\n", (now() - began - 0.2) * 1e3);

  // With SA_RESTART the wait goes on, until the change.
  change(fd, TIOCMBIS, TIOCM_RTS);
  expect(fd, rts_side | dtr_side, "before the wait with SA_RESTART");
  catch_alarms(SA_RESTART);
  alarms = 0;
  alarm_every(50000, 1);
  pthread_create(&other, NULL, drop_rts_later, &fd);
  began = now();
  if (ioctl(fd, TIOCMIWAIT, TIOCM_CTS)) fail_errno("TIOCMIWAIT with SA_RESTART");
  int signals = (int)alarms;
  int lines = lines_of(fd);
  if (signals != 1 || lines & TIOCM_CTS)
    fail("TIOCMIWAIT with SA_RESTART ended after %.3f s, %d signals, CTS %s", now() - began, signals,
         lines & TIOCM_CTS ? "on" : "off");
  pthread_join(other, NULL);
}

// The change comes from the device: of a tape.
static void check_wait_device(void) {
  int fd = open_port(0);
  if (lines_of(fd) & TIOCM_CTS) fail("CTS is on at first");
  if (ioctl(fd, TIOCMIWAIT, TIOCM_CTS)) fail_errno("TIOCMIWAIT");
  if (!(lines_of(fd) & TIOCM_CTS)) fail("CTS is off after the wait for it");
  read_back(fd, "changed");
}

static void check_nonblock(void) {
  int fd = open_port(O_NONBLOCK);
  char byte;
  if (read(fd, &byte, 1) != -1 || errno != EAGAIN) fail("read of nothing: %s", strerror(errno));
  struct pollfd wanted = {fd, POLLIN, 0};
  double began = now();
  if (poll(&wanted, 1, 100) != 0 || now() - began < 0.09)
    fail("poll of nothing: events 0x%x after %.3f s", wanted.revents, now() - began);
  try_lines(fd, "nonblock");
  write_all(fd, "nonblock", 8);
  if (tcdrain(fd)) fail_errno("tcdrain");
  if (poll(&wanted, 1, 120000) != 1 || wanted.revents != POLLIN) fail("poll: 0x%x", wanted.revents);
  char got[8];
  for (size_t have = 0; have < sizeof got;) {
    ssize_t count = read(fd, got + have, sizeof got - have);
    if (count > 0) have += (size_t)count;
    if (count < 0 && errno != EAGAIN) fail_errno("read");
  }
  if (tcflush(fd, TCIOFLUSH)) fail_errno("tcflush");
  if (read(fd, &byte, 1) != -1 || errno != EAGAIN) fail("read after the flush: %s", strerror(errno));
}

static void send_descriptor(int to, int fd) {
  char byte = 0, control[CMSG_SPACE(sizeof fd)] = {0};
  struct iovec data = {&byte, 1};
  struct msghdr message = {
      .msg_iov = &data, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
  struct cmsghdr* header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET, header->cmsg_type = SCM_RIGHTS, header->cmsg_len = CMSG_LEN(sizeof fd);
  memcpy(CMSG_DATA(header), &fd, sizeof fd);
  if (sendmsg(to, &message, 0) != 1) fail_errno("sendmsg");
}

static int receive_descriptor(int from) {
  char byte, control[CMSG_SPACE(sizeof(int))];
  struct iovec data = {&byte, 1};
  struct msghdr message = {
      .msg_iov = &data, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
  if (recvmsg(from, &message, 0) != 1) fail_errno("recvmsg");
  int fd;
  memcpy(&fd, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof fd);
  return fd;
}

static void expect_child(const char* who) {
  int status;
  if (wait(&status) < 0 || status != 0) fail("%s: status 0x%x", who, status);
}

static void check_copies(void) {
  int fd = open_port(0);
  try_lines(dup(fd), "a copy by dup");
  try_lines(dup2(fd, 100), "a copy by dup2");
  try_lines(fcntl(fd, F_DUPFD_CLOEXEC, 200), "a copy by fcntl");
  if (fork() == 0) {
    try_lines(fd, "a forked child");
    read_back(fd, "child");
    _exit(0);
  }
  expect_child("a forked child");
  int sockets[2];
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, sockets)) fail_errno("socketpair");
  if (fork() == 0) {
    try_lines(receive_descriptor(sockets[1]), "a received copy");
    _exit(0);
  }
  send_descriptor(sockets[0], fd);
  expect_child("a received copy");
  if (fork() == 0) {
    dup2(fd, 0);
    execl("/proc/self/exe", "line_calls", "stdin", path, (char*)NULL);
    _exit(127);
  }
  expect_child("one that has inherited it as its input");
}

static void check_stdin(void) {
  try_lines(0, "as input");
  if (!isatty(0)) fail("the input is no tty");
}

// Its own session, and a parent that has left: the one that waits here waits for a pipe's end.
static void check_daemon(void) {
  int ends[2];
  if (pipe(ends)) fail_errno("pipe");
  if (fork() == 0) {
    setsid();
    if (fork() != 0) _exit(0);
    while (getppid() == 1) usleep(1000);  // whoever adopts it
    close(ends[0]);
    int fd = open_port(0);
    try_lines(fd, "a daemon");
    read_back(fd, "daemon");
    if (write(ends[1], "right", 5) != 5) fail_errno("write");
    _exit(0);
  }
  close(ends[1]);
  expect_child("the one between");
  char said[8];
  if (read(ends[0], said, sizeof said) != 5) fail("the daemon did not come to its end");
}

enum { threads = 8, rounds = 200 };
static void* use_lines(void* argument) {
  int fd = *(int*)argument, lines;
  for (int round = 0; round < rounds; ++round) {
    if (ioctl(fd, TIOCMGET, &lines)) fail_errno("TIOCMGET in a thread");
    lines = TIOCM_RTS;
    if (ioctl(fd, round % 2 ? TIOCMBIS : TIOCMBIC, &lines)) fail_errno("TIOCMBIS in a thread");
    struct termios mode;
    if (tcgetattr(fd, &mode)) fail_errno("tcgetattr in a thread");
  }
  return NULL;
}

static void check_threads(void) {
  int fd = open_port(0);
  pthread_t all[threads];
  for (int at = 0; at < threads; ++at) pthread_create(&all[at], NULL, use_lines, &fd);
  for (int at = 0; at < threads; ++at) pthread_join(all[at], NULL);
  try_lines(fd, "after the threads");
  read_back(fd, "threads");
}

// Calls until it is ended. Argument: a file that gets a line for each call that fails, and one each 100
// calls.
static void check_for_ever(const char* notes) {
  FILE* file = fopen(notes, "a");
  if (!file) fail_errno(notes);
  setvbuf(file, NULL, _IOLBF, 0);
  int fd = open_port(0);
  for (int count = 1;; ++count) {
    int lines;
    struct termios mode;
    if (ioctl(fd, TIOCMGET, &lines)) fprintf(file, "TIOCMGET: %d\n", errno);
    if (tcgetattr(fd, &mode)) fprintf(file, "tcgetattr: %d\n", errno);
    if (count % 100 == 0) fprintf(file, "calls %d\n", count);
    usleep(1000);
  }
}

// Waits for a change that never comes, as a child of one that does the same.
static void check_wait_for_ever(const char* notes) {
  int fd = open_port(0);
  fork();
  FILE* file = fopen(notes, "a");
  if (!file) fail_errno(notes);
  fprintf(file, "waits\n");
  fflush(file);
  int result = ioctl(fd, TIOCMIWAIT, TIOCM_RI);
  fprintf(file, "ended: %d %d\n", result, errno);
  fclose(file);
}

static void check_open(void) {
  int fd = open_port(0);
  lines_of(fd);
  close(fd);
}

static const struct {
  const char* name;
  void (*run)(void);
  void (*run_count)(int);
  void (*run_file)(const char*);
} checks[] = {
    {"lines", check_lines, NULL, NULL},
    {"mode", check_mode, NULL, NULL},
    {"storm", NULL, check_storm, NULL},
    {"wait", check_wait, NULL, NULL},
    {"wait-device", check_wait_device, NULL, NULL},
    {"nonblock", check_nonblock, NULL, NULL},
    {"copies", check_copies, NULL, NULL},
    {"stdin", check_stdin, NULL, NULL},
    {"daemon", check_daemon, NULL, NULL},
    {"threads", check_threads, NULL, NULL},
    {"for-ever", NULL, NULL, check_for_ever},
    {"wait-for-ever", NULL, NULL, check_wait_for_ever},
    {"open", check_open, NULL, NULL},
};

int main(int count, char** arguments) {
  for (size_t at = 0; count >= 3 && at < sizeof checks / sizeof *checks; ++at) {
    if (strcmp(checks[at].name, arguments[1]) != 0) continue;
    path = arguments[2];
    if (checks[at].run)
      checks[at].run();
    else if (count < 4)
      break;
    else if (checks[at].run_count)
      checks[at].run_count(atoi(arguments[3]));
    else
      checks[at].run_file(arguments[3]);
    return 0;
  }
  fputs("usage: line_calls WHAT PORT [ARGUMENT]\n", stderr);
  return 64;
}
