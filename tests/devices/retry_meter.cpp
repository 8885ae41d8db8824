// A driver of a meter that answers numbered requests; it repeats what went wrong. With a bug it does not come
// through all faults of its line.
//
//   retry_meter PORT COUNT [good|parser|twice]
//
//   ?0001          the request
//   !0001 00037*5A the answer: number, value, and the XOR of what stands between ! and *
//
// parser: an answer without its * ends the program. twice: an answer that comes again counts for the next
// request.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <optional>
#include <poll.h>
#include <stdexcept>
#include <string>
#include <string_view>
#include <termios.h>
#include <unistd.h>

namespace {

constexpr int kTries = 8;
constexpr int kAnswerMs = 200;
constexpr int kQuietMs = 10;

enum class Bug { none, parser, twice };

int open_raw(const char* path) {
  const int fd = ::open(path, O_RDWR | O_NOCTTY);
  termios line{};
  if (fd < 0 || ::tcgetattr(fd, &line) != 0) return -1;
  ::cfmakeraw(&line);
  return ::tcsetattr(fd, TCSANOW, &line) == 0 ? fd : -1;
}

// A byte; none in this time.
std::optional<char> read_byte(int fd, int milliseconds) {
  pollfd polled{.fd = fd, .events = POLLIN, .revents = 0};
  char byte = 0;
  if (::poll(&polled, 1, milliseconds) <= 0) return std::nullopt;
  if (::read(fd, &byte, 1) != 1) throw std::runtime_error("the line is gone");
  return byte;
}

std::optional<std::string> read_line(int fd) {
  std::string line;
  while (const auto byte = read_byte(fd, kAnswerMs)) {
    if (*byte == '\n') return line;
    line += *byte;
  }
  return std::nullopt;
}

void wait_for_quiet(int fd) {
  while (read_byte(fd, kQuietMs)) {
  }
}

int check_of(std::string_view text) {
  int check = 0;
  for (const char each : text) check ^= static_cast<unsigned char>(each);
  return check;
}

// The value, if it is the answer to this request.
std::optional<int> value_of(const std::string& line, int number, Bug bug) {
  const std::size_t star = line.find('*');
  if (bug != Bug::parser && star == std::string::npos) return std::nullopt;
  const std::string digits = line.substr(star + 1);
  if (bug != Bug::parser &&
      (digits.size() != 2 || digits.find_first_not_of("0123456789ABCDEF") != std::string::npos))
    return std::nullopt;
  const int check = std::stoi(digits, nullptr, 16);  // throws where there are none
  if (line.empty() || line[0] != '!' || check != check_of(std::string_view(line).substr(1, star - 1)))
    return std::nullopt;
  int of = 0;
  int value = 0;
  if (std::sscanf(line.c_str(), "!%4d %5d*", &of, &value) != 2) return std::nullopt;
  return of == number || bug == Bug::twice ? std::optional(value) : std::nullopt;
}

std::optional<int> ask(int fd, int number, Bug bug) {
  char request[16];
  const int size = std::snprintf(request, sizeof request, "?%04d\n", number);
  for (int tries = 0; tries < kTries; ++tries) {
    if (::write(fd, request, static_cast<std::size_t>(size)) != size)
      throw std::runtime_error("cannot write");
    if (const auto line = read_line(fd)) {
      if (const auto value = value_of(*line, number, bug)) return value;
    }
    wait_for_quiet(fd);
  }
  return std::nullopt;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const std::string_view word = argc > 3 ? argv[3] : "good";
  const Bug bug = word == "parser" ? Bug::parser : word == "twice" ? Bug::twice : Bug::none;
  const int fd = open_raw(argv[1]);
  if (fd < 0) {
    std::perror(argv[1]);
    return 2;
  }
  const int count = std::atoi(argv[2]);
  for (int number = 1; number <= count; ++number) {
    const auto value = ask(fd, number, bug);
    if (!value) {
      std::fprintf(stderr, "gave up: no answer to request %d\n", number);
      return 3;
    }
    if (*value != number * 37 % 100000) {
      std::fprintf(stderr, "wrong: request %d has the value %d\n", number, *value);
      return 1;
    }
  }
  return 0;
}
