// tty_program TTY RESULT STEP…: does the steps to a tty, one after another, and writes a line of what came of
// each.
#include <errno.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include "tests/supervise/crowd.hpp"

static void on_alarm(int number) { (void)number; }

static void change(int fd, const char* step) {
  int bit = strncmp(step, "rts", 3) == 0 ? TIOCM_RTS : TIOCM_DTR;
  ioctl(fd, step[3] == '+' ? TIOCMBIS : TIOCMBIC, &bit);
}

static void set(int fd, FILE* out, const char* frame) {
  struct termios tio;
  tcgetattr(fd, &tio);
  cfmakeraw(&tio);
  tio.c_cflag &= ~(tcflag_t)(CSIZE | PARENB | PARODD);
  tio.c_cflag |= frame[0] == '7' ? CS7 : CS8;
  if (frame[1] != 'N') tio.c_cflag |= PARENB;
  if (frame[1] == 'O') tio.c_cflag |= PARODD;
  if (frame[2] == 'c') {
    tio.c_cflag &= ~(tcflag_t)CLOCAL;
  } else {
    tio.c_cflag |= CLOCAL;
  }
  cfsetspeed(&tio, B19200);
  const int result = tcsetattr(fd, TCSADRAIN, &tio);
  memset(&tio, 0, sizeof(tio));
  tcgetattr(fd, &tio);
  fprintf(out, "set %d %c%c%s\n", result, (tio.c_cflag & CSIZE) == CS7 ? '7' : '8',
          (tio.c_cflag & PARENB) == 0   ? 'N'
          : (tio.c_cflag & PARODD) != 0 ? 'O'
                                        : 'E',
          (tio.c_cflag & CLOCAL) != 0 ? "" : "c");
}

// The kernel's own structures, which glibc's is not.
struct KernelTermios {
  unsigned iflag, oflag, cflag, lflag;
  unsigned char line, cc[19];
  unsigned ispeed, ospeed;  // of a termios2 alone
};
struct KernelTermio {
  unsigned short iflag, oflag, cflag, lflag;
  unsigned char line, cc[8];
};

static const char* frame_name(unsigned cflag, char* name) {
  const unsigned sizes[] = {CS5, CS6, CS7, CS8};
  for (unsigned i = 0; i < 4; ++i) {
    if ((cflag & CSIZE) == sizes[i]) name[0] = (char)('5' + (char)i);
  }
  const int odd = (cflag & PARODD) != 0;
  const int stick = (cflag & 010000000000) != 0;  // CMSPAR
  name[1] = (cflag & PARENB) == 0 ? 'N' : stick ? (odd ? 'M' : 'S') : odd ? 'O' : 'E';
  name[2] = '\0';
  return name;
}

// Each request that makes settings, with a frame that the one before had not, and what the one that goes with
// it gives then.
static void set_each_form(int fd, FILE* out) {
  const struct {
    const char* name;
    unsigned long makes, gives;
    int small;
  } forms[] = {{"TCSETS", 0x5402, 0x5401, 0},          {"TCSETSW", 0x5403, 0x5401, 0},
               {"TCSETSF", 0x5404, 0x5401, 0},         {"TCSETA", 0x5406, 0x5405, 1},
               {"TCSETAW", 0x5407, 0x5405, 1},         {"TCSETAF", 0x5408, 0x5405, 1},
               {"TCSETS2", 0x402c542b, 0x802c542a, 0}, {"TCSETSW2", 0x402c542c, 0x802c542a, 0},
               {"TCSETSF2", 0x402c542d, 0x802c542a, 0}};
  char name[4];
  for (size_t i = 0; i < sizeof(forms) / sizeof(forms[0]); ++i) {
    const unsigned cflag = B9600 | CREAD | CLOCAL | PARENB | (i % 2 == 0 ? CS7 : CS8 | PARODD);
    int made = 0;
    int given = 0;
    unsigned read_back = 0;
    if (forms[i].small) {
      struct KernelTermio tio;
      memset(&tio, 0, sizeof(tio));
      tio.cflag = (unsigned short)cflag;
      made = ioctl(fd, forms[i].makes, &tio);
      memset(&tio, 0, sizeof(tio));
      given = ioctl(fd, forms[i].gives, &tio);
      read_back = tio.cflag;
    } else {
      struct KernelTermios tio;
      memset(&tio, 0, sizeof(tio));
      tio.cflag = cflag;
      made = ioctl(fd, forms[i].makes, &tio);
      memset(&tio, 0, sizeof(tio));
      given = ioctl(fd, forms[i].gives, &tio);
      read_back = tio.cflag;
    }
    fprintf(out, "%s %d %d %s\n", forms[i].name, made, given, frame_name(read_back, name));
  }
}

static void show_frame(int fd, FILE* out) {
  struct KernelTermios tio;
  memset(&tio, 0, sizeof(tio));
  const int result = ioctl(fd, 0x5401, &tio);
  char name[4];
  fprintf(out, "shown %d %s%s%s\n", result, frame_name(tio.cflag, name), (tio.cflag & CLOCAL) != 0 ? "" : "c",
          (tio.iflag & IGNBRK) != 0 ? " ignbrk" : "");
}

static int line_bits(const char* names) {
  return (strstr(names, "dtr") ? TIOCM_DTR : 0) | (strstr(names, "rts") ? TIOCM_RTS : 0) |
         (strstr(names, "cts") ? TIOCM_CTS : 0) | (strstr(names, "dsr") ? TIOCM_DSR : 0) |
         (strstr(names, "cd") ? TIOCM_CD : 0) | (strstr(names, "ri") ? TIOCM_RI : 0);
}

static const char* error_name(void) {
  return errno == 0            ? "0"
         : errno == EIO        ? "EIO"
         : errno == ENOTTY     ? "ENOTTY"
         : errno == EINTR      ? "EINTR"
         : errno == EOPNOTSUPP ? "EOPNOTSUPP"
         : errno == EPERM      ? "EPERM"
                               : "other";
}

static void change_uart(int fd, FILE* out) {
  struct serial_struct serial;
  if (ioctl(fd, TIOCGSERIAL, &serial) != 0) {
    fprintf(out, "serial -1 %s\n", error_name());
    return;
  }
  serial.flags |= ASYNC_LOW_LATENCY;
  fprintf(out, "serial %d type %d\n", ioctl(fd, TIOCSSERIAL, &serial), serial.type);
}

// What takes the rights of an administrator.
static void change_delay(int fd, FILE* out) {
  struct serial_struct serial;
  ioctl(fd, TIOCGSERIAL, &serial);
  serial.close_delay = (unsigned short)(serial.close_delay + 7);
  const int made = ioctl(fd, TIOCSSERIAL, &serial);
  fprintf(out, "delay %d %s\n", made, error_name());
}

static void give_up_rights(FILE* out) {
  const int given_up = geteuid() != 0 || (setgid(65534) == 0 && setuid(65534) == 0);
  fprintf(out, "rights %d\n", !given_up);
}

static void change_rs485(int fd, FILE* out) {
  struct serial_rs485 rs485;
  memset(&rs485, 0, sizeof(rs485));
  rs485.flags = SER_RS485_ENABLED;
  rs485.delay_rts_after_send = 3;
  const int made = ioctl(fd, TIOCSRS485, &rs485);
  if (made != 0) {
    fprintf(out, "rs485 %d %s\n", made, error_name());
    return;
  }
  fprintf(out, "rs485 %d after %u, ", made, rs485.delay_rts_after_send);
  const int read_back = ioctl(fd, TIOCGRS485, &rs485);
  fprintf(out, "%d after %u\n", read_back, rs485.delay_rts_after_send);
}

static void alarm_in(int ms, int flags) {
  struct sigaction action;
  memset(&action, 0, sizeof(action));
  action.sa_handler = on_alarm;
  action.sa_flags = flags;
  sigaction(SIGALRM, &action, NULL);
  struct itimerval timer = {{0, ms * 1000}, {0, ms * 1000}};  // again and again: the first may be early
  setitimer(ITIMER_REAL, &timer, NULL);
}

static void* ask(void* fd) {
  int bits = 0;
  return ioctl(*(int*)fd, TIOCMGET, &bits) == 0 ? fd : NULL;
}

// So many children, one after another, and one thread.
static void ask_elsewhere(int fd, FILE* out, int children) {
  int answered = 0;
  for (int i = 0; i < children; ++i) {
    const pid_t child = fork();
    if (child == 0) _exit(ask((void*)&fd) != NULL ? 0 : 1);
    int status = 1;
    if (waitpid(child, &status, 0) == child && status == 0) ++answered;
  }
  pthread_t thread;
  void* of_thread = NULL;
  if (pthread_create(&thread, NULL, ask, (void*)&fd) == 0) pthread_join(thread, &of_thread);
  fprintf(out, "children %d thread %d\n", answered, of_thread != NULL);
}

// So many threads wait for a line, beside a call that is answered at once. Each way of sending a signal then
// interrupts one of them.
static void wait_in_crowd(int fd, FILE* out, int size) {
  struct sigaction action;
  memset(&action, 0, sizeof(action));
  action.sa_handler = on_alarm;
  sigaction(SIGUSR1, &action, NULL);
  porttape::test::Crowd crowd(size, [fd] { return ioctl(fd, TIOCMIWAIT, TIOCM_RNG); });
  int bits = 0;
  fprintf(out, "beside %d\n", ioctl(fd, TIOCMGET, &bits));

  const pthread_t one = crowd.thread(size / 2);
  fprintf(out, "thread %s\n", crowd.ended_by([one] { pthread_kill(one, SIGUSR1); }).c_str());

  struct sigevent event;
  memset(&event, 0, sizeof(event));
  event.sigev_notify = SIGEV_THREAD_ID;
  event.sigev_signo = SIGUSR1;
  event._sigev_un._tid = crowd.number(size / 3);
  timer_t timer;
  if (timer_create(CLOCK_MONOTONIC, &event, &timer) != 0) _exit(9);
  const struct itimerspec soon = {{0, 0}, {0, 1000}};
  const auto by_timer = [&] { timer_settime(timer, 0, &soon, NULL); };
  fprintf(out, "timer %s\n", crowd.ended_by(by_timer).c_str());

  // The threads that have ended their wait leave it to those that have not.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGUSR1);
  pthread_sigmask(SIG_BLOCK, &signals, NULL);
  fprintf(out, "process %s\n", crowd.ended_by([] { kill(getpid(), SIGUSR1); }).c_str());
}

// The number of the tty is that of another file for a moment.
static void ask_other(int fd, FILE* out) {
  const int kept = dup(fd);
  const int null = open("/dev/null", O_RDWR);
  int bits = 0;
  dup2(null, fd);
  int result = ioctl(fd, TIOCMGET, &bits);
  fprintf(out, "other %d %s\n", result, errno == ENOTTY ? "ENOTTY" : "other");
  close(fd);
  result = ioctl(fd, TIOCMGET, &bits);
  fprintf(out, "closed %d %s\n", result, errno == EBADF ? "EBADF" : "other");
  dup2(kept, fd);
  close(kept);
  close(null);
}

int main(int count, char** words) {
  FILE* out = fopen(words[2], getenv("TTY_PROGRAM_GOES_ON") != NULL ? "a" : "w");
  int fd = open(words[1], O_RDWR | O_NOCTTY);
  if (fd < 0 || out == NULL) return 9;
  for (int i = 3; i < count; ++i) {
    const char* step = words[i];
    errno = 0;
    if (strcmp(step, "session") == 0) {
      const pid_t child = fork();
      if (child != 0) {
        int status = 0;
        waitpid(child, &status, 0);
        return WEXITSTATUS(status);
      }
      setsid();
      if (ioctl(fd, TIOCSCTTY, 0) != 0) return 6;
      close(fd);
      fd = open("/dev/tty", O_RDWR);
      if (fd < 0) return 5;
    } else if (strcmp(step, "lines") == 0) {
      int bits = 0;
      const int result = ioctl(fd, TIOCMGET, &bits);
      fprintf(out, "lines %d%s%s%s%s%s%s\n", result, bits & TIOCM_DTR ? " dtr" : "",
              bits & TIOCM_RTS ? " rts" : "", bits & TIOCM_CTS ? " cts" : "", bits & TIOCM_DSR ? " dsr" : "",
              bits & TIOCM_CD ? " cd" : "", bits & TIOCM_RI ? " ri" : "");
    } else if (strncmp(step, "rts", 3) == 0 || strncmp(step, "dtr", 3) == 0) {
      change(fd, step);
    } else if (strncmp(step, "set:", 4) == 0) {
      set(fd, out, step + 4);
    } else if (strcmp(step, "drain") == 0) {
      fprintf(out, "drain %d\n", tcdrain(fd));
    } else if (strcmp(step, "flush") == 0) {
      fprintf(out, "flush %d\n", tcflush(fd, TCIOFLUSH));
    } else if (strcmp(step, "break") == 0 || strncmp(step, "break:", 6) == 0) {
      const int result = ioctl(fd, TCSBRKP, step[5] == ':' ? atoi(step + 6) : 1);
      fprintf(out, "break %d %s\n", result, error_name());
    } else if (strcmp(step, "break+") == 0) {
      const int result = ioctl(fd, TIOCSBRK);
      fprintf(out, "break+ %d %s\n", result, error_name());
    } else if (strcmp(step, "delay") == 0) {
      change_delay(fd, out);
    } else if (strcmp(step, "give-up-rights") == 0) {
      give_up_rights(out);
    } else if (strcmp(step, "serial") == 0) {
      change_uart(fd, out);
    } else if (strcmp(step, "rs485") == 0) {
      change_rs485(fd, out);
    } else if (strncmp(step, "write:", 6) == 0) {
      fprintf(out, "write %zd\n", write(fd, step + 6, strlen(step + 6)));
    } else if (strncmp(step, "alarm:", 6) == 0) {
      alarm_in(atoi(step + 6), step[strlen(step) - 1] == 'r' ? SA_RESTART : 0);
    } else if (strcmp(step, "forms") == 0) {
      set_each_form(fd, out);
    } else if (strcmp(step, "shown") == 0) {
      show_frame(fd, out);
    } else if (strncmp(step, "lines=", 6) == 0) {
      int bits = line_bits(step + 6);
      fprintf(out, "lines= %d\n", ioctl(fd, TIOCMSET, &bits));
    } else if (strncmp(step, "rate:", 5) == 0) {
      struct termios tio;
      tcgetattr(fd, &tio);
      cfsetspeed(&tio, atoi(step + 5) == 0 ? B0 : B4800);
      fprintf(out, "rate %d\n", tcsetattr(fd, TCSANOW, &tio));
    } else if (strncmp(step, "wait:", 5) == 0) {
      const int result = ioctl(fd, TIOCMIWAIT, line_bits(step + 5));
      fprintf(out, "wait %d %s\n", result, error_name());
    } else if (strcmp(step, "counts") == 0) {
      struct serial_icounter_struct counters;
      const int result = ioctl(fd, TIOCGICOUNT, &counters);
      fprintf(out, "counts %d cts %d dsr %d cd %d ri %d brk %d\n", result, counters.cts, counters.dsr,
              counters.dcd, counters.rng, counters.brk);
    } else if (strcmp(step, "wait") == 0) {
      const int result = ioctl(fd, TIOCMIWAIT, TIOCM_CTS);
      fprintf(out, "wait %d %s\n", result, error_name());
    } else if (strcmp(step, "count") == 0) {
      struct serial_icounter_struct counters;
      const int result = ioctl(fd, TIOCGICOUNT, &counters);
      fprintf(out, "count %d cts %d\n", result, counters.cts);
    } else if (strcmp(step, "other") == 0) {
      ask_other(fd, out);
    } else if (strncmp(step, "children:", 9) == 0) {
      ask_elsewhere(fd, out, atoi(step + 9));
    } else if (strncmp(step, "crowd:", 6) == 0) {
      wait_in_crowd(fd, out, atoi(step + 6));
    } else if (strcmp(step, "exec") == 0) {
      setenv("TTY_PROGRAM_GOES_ON", "1", 1);
      words[i] = words[2];
      words[i - 1] = words[1];
      words[i - 2] = words[0];
      fclose(out);
      execv(words[0], words + i - 2);
      return 6;
    } else if (strcmp(step, "bad") == 0) {
      const int result = ioctl(fd, TIOCMGET, (void*)8);
      fprintf(out, "bad %d %s\n", result, errno == EFAULT ? "EFAULT" : "other");
    } else {
      return 8;
    }
    fflush(out);
  }
  close(fd);
  return fclose(out) == 0 ? 0 : 7;
}
