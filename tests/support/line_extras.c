// line_extras.c: what few drivers do to the kernel, for tests of a supervisor. Status 0: all is as without
// one; 3: refused.
//
//   line_extras notifier PORT        asks for a seccomp listener of its own, and for the line's signals
//   line_extras uring PORT           writes and reads back by io_uring
//   line_extras closed PORT          lets nobody without rights look into its process, and asks for the signals
//   line_extras without CALL… -- COMMAND…    runs COMMAND with these calls forbidden: seccomp, unshare,
//   pidfd_getfd, io_uring
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/io_uring.h>
#include <linux/seccomp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <termios.h>
#include <unistd.h>

static int give_up(int status, const char* what) {
  fprintf(stderr, "line_extras: %s: %s (%d)\n", what, strerror(errno), errno);
  exit(status);
}

static int open_port(const char* path) {
  int fd = open(path, O_RDWR | O_NOCTTY);
  struct termios mode;
  if (fd < 0 || tcgetattr(fd, &mode)) give_up(1, path);
  cfmakeraw(&mode);
  if (tcsetattr(fd, TCSANOW, &mode)) give_up(1, path);
  return fd;
}

static int check_notifier(const char* path) {
  int fd = open_port(path), lines;
  struct sock_filter allow = {BPF_RET | BPF_K, 0, 0, SECCOMP_RET_ALLOW};
  struct sock_fprog program = {1, &allow};
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)) give_up(1, "PR_SET_NO_NEW_PRIVS");
  // One without a listener is anybody's right.
  if (syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, 0, &program)) give_up(1, "a filter without a listener");
  int listener =
      (int)syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_NEW_LISTENER, &program);
  int refused = errno;
  if (ioctl(fd, TIOCMGET, &lines)) give_up(1, "TIOCMGET");
  if (listener < 0) {
    errno = refused;
    give_up(3, "a listener of its own");
  }
  return 0;
}

static int check_closed(const char* path) {
  int fd = open_port(path), lines;
  if (prctl(PR_SET_DUMPABLE, 0, 0, 0, 0)) give_up(1, "PR_SET_DUMPABLE");
  if (ioctl(fd, TIOCMGET, &lines)) give_up(3, "TIOCMGET");
  return 0;
}

static int check_uring(const char* path) {
  int fd = open_port(path);
  struct io_uring_params params = {0};
  int ring = (int)syscall(SYS_io_uring_setup, 4, &params);
  if (ring < 0) give_up(3, "io_uring_setup");
  char* sq = mmap(NULL, params.sq_off.array + params.sq_entries * 4, PROT_READ | PROT_WRITE, MAP_SHARED, ring,
                  IORING_OFF_SQ_RING);
  char* cq = mmap(NULL, params.cq_off.cqes + params.cq_entries * sizeof(struct io_uring_cqe),
                  PROT_READ | PROT_WRITE, MAP_SHARED, ring, IORING_OFF_CQ_RING);
  struct io_uring_sqe* entries = mmap(NULL, params.sq_entries * sizeof *entries, PROT_READ | PROT_WRITE,
                                      MAP_SHARED, ring, IORING_OFF_SQES);
  if (sq == MAP_FAILED || cq == MAP_FAILED || entries == MAP_FAILED) give_up(1, "mmap of a ring");
  char data[8] = "by ring", got[8] = "";
  size_t have = 0;
  for (int turn = 0; have < 7 && turn < 8; ++turn) {
    char* buffer = turn == 0 ? data : got + have;
    unsigned tail = *(unsigned*)(sq + params.sq_off.tail), mask = *(unsigned*)(sq + params.sq_off.ring_mask);
    entries[tail & mask] = (struct io_uring_sqe){.opcode = turn == 0 ? IORING_OP_WRITE : IORING_OP_READ,
                                                 .fd = fd,
                                                 .addr = (size_t)buffer,
                                                 .len = (unsigned)(7 - have),
                                                 .off = (__u64)-1};
    ((unsigned*)(sq + params.sq_off.array))[tail & mask] = tail & mask;
    __atomic_store_n((unsigned*)(sq + params.sq_off.tail), tail + 1, __ATOMIC_RELEASE);
    if (syscall(SYS_io_uring_enter, ring, 1, 1, IORING_ENTER_GETEVENTS, NULL, 0) < 0)
      give_up(1, "io_uring_enter");
    unsigned* head = (unsigned*)(cq + params.cq_off.head);
    struct io_uring_cqe* done = (struct io_uring_cqe*)(cq + params.cq_off.cqes) +
                                (*head & *(unsigned*)(cq + params.cq_off.ring_mask));
    if (done->res <= 0) errno = -done->res, give_up(1, "read or write by io_uring");
    if (turn > 0) have += (size_t)done->res;
    __atomic_store_n(head, *head + 1, __ATOMIC_RELEASE);
  }
  if (memcmp(data, got, 7) != 0) fprintf(stderr, "line_extras: got %s\n", got), exit(1);
  return 0;
}

static const struct {
  const char* name;
  unsigned number;
} calls[] = {{"seccomp", SYS_seccomp},
             {"unshare", SYS_unshare},
             {"pidfd_getfd", SYS_pidfd_getfd},
             {"pidfd_open", SYS_pidfd_open},
             {"process_vm_readv", SYS_process_vm_readv},
             {"clone3", SYS_clone3}};

static int run_without(char** words) {
  struct sock_filter filter[2 * sizeof calls / sizeof *calls + 2] = {
      {BPF_LD | BPF_W | BPF_ABS, 0, 0, offsetof(struct seccomp_data, nr)}};
  unsigned short size = 1;
  for (; *words && strcmp(*words, "--") != 0; ++words) {
    size_t at = 0;
    while (at < sizeof calls / sizeof *calls && strcmp(calls[at].name, *words) != 0) ++at;
    if (at == sizeof calls / sizeof *calls)
      return fprintf(stderr, "line_extras: which call is %s?\n", *words), 64;
    filter[size++] = (struct sock_filter){BPF_JMP | BPF_JEQ | BPF_K, 0, 1, calls[at].number};
    filter[size++] = (struct sock_filter){BPF_RET | BPF_K, 0, 0, SECCOMP_RET_ERRNO | EPERM};
  }
  filter[size++] = (struct sock_filter){BPF_RET | BPF_K, 0, 0, SECCOMP_RET_ALLOW};
  struct sock_fprog program = {size, filter};
  if (!*words || prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) ||
      prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program))
    give_up(1, "a filter");
  execvp(words[1], words + 1);
  return give_up(127, words[1]);
}

int main(int count, char** arguments) {
  if (count == 3 && strcmp(arguments[1], "notifier") == 0) return check_notifier(arguments[2]);
  if (count == 3 && strcmp(arguments[1], "closed") == 0) return check_closed(arguments[2]);
  if (count == 3 && strcmp(arguments[1], "uring") == 0) return check_uring(arguments[2]);
  if (count > 3 && strcmp(arguments[1], "without") == 0) return run_without(arguments + 2);
  fputs("usage: line_extras notifier|closed|uring PORT, or without CALL… -- COMMAND…\n", stderr);
  return 64;
}
