// A serial flash programmer speaking serprog (version 1, SPI only) with a Winbond W25Q80 (1 MiB) in its
// socket.
//
//   serprog_flash TTY IMAGE      IMAGE: a file of 1 MiB, the chip's content; changed in place
//   serprog_flash tcp:PORT IMAGE     on 127.0.0.1, one connection after the other
//
// It is ready at once (no operation is ever busy), so the same job gives the same bytes each time.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <initializer_list>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <span>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace {

using Byte = std::uint8_t;

constexpr std::size_t kChipSize = std::size_t{1} << 20;
constexpr Byte kAck = 0x06;
constexpr Byte kNak = 0x15;

class Chip {
 public:
  explicit Chip(std::span<Byte> content) : content_(content) {}

  // One operation between chip select low and high: `sent` goes in, `answer` is filled with what comes out
  // after it.
  void transfer(std::span<const Byte> sent, std::span<Byte> answer) {
    std::fill(answer.begin(), answer.end(), Byte{0xFF});
    if (sent.empty()) return;
    switch (sent[0]) {
      case 0x06:
        write_enabled_ = true;
        return;
      case 0x04:
        write_enabled_ = false;
        return;
      case 0x05:
        std::fill(answer.begin(), answer.end(), status());
        return;
      case 0x9F:
        put(answer, {0xEF, 0x40, 0x14});
        return;
      case 0x90:
        put(answer, {0xEF, 0x13});
        return;
      case 0xAB:
        put(answer, {0x13});
        return;
      default:
        break;
    }
    if (sent[0] == 0x60 || sent[0] == 0xC7) return erase(0, kChipSize);
    if (sent.size() < 4) return;
    const std::size_t address =
        (std::size_t{sent[1]} << 16 | std::size_t{sent[2]} << 8 | sent[3]) % kChipSize;
    switch (sent[0]) {
      case 0x03:
        for (std::size_t n = 0; n < answer.size(); ++n) answer[n] = content_[(address + n) % kChipSize];
        return;
      case 0x02:
        return program(address, sent.subspan(4));
      case 0x20:
        return erase(address, 4096);
      case 0x52:
      case 0xD8:
        return erase(address, 65536);
      default:
        return;
    }
  }

 private:
  static void put(std::span<Byte> answer, std::initializer_list<Byte> bytes) {
    std::copy_n(bytes.begin(), std::min(bytes.size(), answer.size()), answer.begin());
  }

  [[nodiscard]] Byte status() const { return write_enabled_ ? 0x02 : 0x00; }

  void erase(std::size_t address, std::size_t size) {
    if (!std::exchange(write_enabled_, false)) return;
    const std::size_t start = address / size * size;
    std::fill_n(content_.begin() + static_cast<std::ptrdiff_t>(start), size, Byte{0xFF});
  }

  // Programming only clears bits, and wraps inside its page of 256 bytes.
  void program(std::size_t address, std::span<const Byte> data) {
    if (!std::exchange(write_enabled_, false)) return;
    const std::size_t page = address & ~std::size_t{0xFF};
    for (std::size_t n = 0; n < data.size(); ++n) content_[page + ((address + n) & 0xFF)] &= data[n];
  }

  std::span<Byte> content_;
  bool write_enabled_ = false;
};

class Line {
 public:
  explicit Line(int fd) : fd_(fd) {}

  Byte get() {
    if (at_ == size_) {
      const ssize_t got = read(fd_, buffer_.data(), buffer_.size());
      if (got <= 0) std::exit(0);  // the line was hung up
      size_ = static_cast<std::size_t>(got);
      at_ = 0;
    }
    return buffer_[at_++];
  }

  std::size_t get_number(int bytes) {
    std::size_t value = 0;
    for (int n = 0; n < bytes; ++n) value |= std::size_t{get()} << 8 * n;
    return value;
  }

  void put(std::span<const Byte> data) {
    while (!data.empty()) {
      const ssize_t done = write(fd_, data.data(), data.size());
      if (done <= 0) std::exit(0);
      data = data.subspan(static_cast<std::size_t>(done));
    }
  }

  void put(std::initializer_list<Byte> data) { put(std::span(data.begin(), data.size())); }

 private:
  int fd_;
  std::array<Byte, 4096> buffer_{};
  std::size_t at_ = 0, size_ = 0;
};

void spi_operation(Line& line, Chip& chip) {
  std::vector<Byte> sent(line.get_number(3));
  std::vector<Byte> answer(1 + line.get_number(3));
  std::generate(sent.begin(), sent.end(), [&line] { return line.get(); });
  chip.transfer(sent, std::span(answer).subspan(1));
  answer[0] = kAck;
  line.put(answer);
}

void name_of_programmer(Line& line) {
  std::array<Byte, 17> answer{kAck};
  constexpr char kName[] = "porttape sim";
  std::memcpy(answer.data() + 1, kName, sizeof kName);
  line.put(answer);
}

void command_map(Line& line) {
  std::array<Byte, 33> answer{kAck};
  for (const int command : {0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x08, 0x10, 0x11, 0x12, 0x13})
    answer[static_cast<std::size_t>(1 + command / 8)] |= static_cast<Byte>(1 << command % 8);
  line.put(answer);
}

[[noreturn]] void serve(Line line, Chip chip) {
  for (;;) {
    switch (line.get()) {
      case 0x00:
        line.put({kAck});
        break;
      case 0x01:
        line.put({kAck, 0x01, 0x00});
        break;
      case 0x02:
        command_map(line);
        break;
      case 0x03:
        name_of_programmer(line);
        break;
      case 0x04:
        line.put({kAck, 0x00, 0x10});
        break;  // 4 KiB of serial buffer
      case 0x05:
        line.put({kAck, 0x08});
        break;  // SPI
      case 0x08:
        line.put({kAck, 0x04, 0x01, 0x00});
        break;  // 260 bytes: one page and its command
      case 0x10:
        line.put({kNak, kAck});
        break;
      case 0x11:
        line.put({kAck, 0x00, 0x10, 0x00});
        break;  // 4 KiB a read
      case 0x12:
        line.put({line.get() == 0x08 ? kAck : kNak});
        break;
      case 0x13:
        spi_operation(line, chip);
        break;
      default:
        line.put({kNak});
        break;
    }
  }
}

int open_raw(const char* path) {
  const int fd = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
  termios mode{};
  if (fd < 0 || tcgetattr(fd, &mode) != 0) return -1;
  cfmakeraw(&mode);
  cfsetspeed(&mode, B115200);
  return tcsetattr(fd, TCSANOW, &mode) == 0 ? fd : -1;
}

[[noreturn]] void serve_tcp(int port, const Chip& chip) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int on = 1;
  const int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(listener, 1) != 0) {
    std::perror("serprog_flash");
    std::exit(1);
  }
  for (;;) {
    const int fd = accept(listener, nullptr, nullptr);
    if (fd < 0) continue;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    const pid_t child = fork();  // serving ends with the process
    if (child == 0) serve(Line(fd), chip);
    close(fd);
    waitpid(child, nullptr, 0);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: serprog_flash TTY|tcp:PORT IMAGE\n");
    return 64;
  }
  const int image = open(argv[2], O_RDWR | O_CLOEXEC);
  struct stat status {};
  if (image < 0 || fstat(image, &status) != 0 || static_cast<std::size_t>(status.st_size) != kChipSize) {
    std::fprintf(stderr, "serprog_flash: %s: not a file of 1 MiB\n", argv[2]);
    return 1;
  }
  void* content = mmap(nullptr, kChipSize, PROT_READ | PROT_WRITE, MAP_SHARED, image, 0);
  if (content == MAP_FAILED) {
    std::perror(argv[2]);
    return 1;
  }
  const Chip chip(std::span(static_cast<Byte*>(content), kChipSize));
  if (std::strncmp(argv[1], "tcp:", 4) == 0) serve_tcp(std::atoi(argv[1] + 4), chip);
  const int fd = open_raw(argv[1]);
  if (fd < 0) {
    std::perror(argv[1]);
    return 1;
  }
  serve(Line(fd), chip);
}
