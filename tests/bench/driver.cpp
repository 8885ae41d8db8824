#include "tests/bench/driver.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include "tests/bench/commands.hpp"
#include "tests/bench/line.hpp"
#include "tests/bench/pattern.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

void ping_pong(int port, std::size_t size, std::uint64_t number) {
  Byte answer[4096];
  const Byte* question = pattern_at(number * size);
  write_all(port, question, size);
  read_exact(port, answer, size);
  if (std::memcmp(question, answer, size) != 0) throw BenchError("the echo differs from what was sent");
}

// What a call gives does not matter, but that it can be done is the same each time.
void act(const Measure& measure, int port, int other, std::uint64_t number) {
  int value = 0;
  termios settings{};
  switch (measure.act) {
    case Act::round_trip:
      return ping_pong(port, measure.size, number);
    case Act::modem_get:
      (void)::ioctl(port, TIOCMGET, &value);
      return;
    case Act::modem_clear:
      (void)::ioctl(port, TIOCMBIC, &value);
      return;
    case Act::settings:
      (void)::ioctl(port, TCGETS, &settings);
      return;
    case Act::elsewhere:
      (void)::ioctl(other, TCGETS, &settings);
      return;
    case Act::queued:
      (void)::ioctl(port, FIONREAD, &value);
      return;
    case Act::parent:
      (void)::getppid();
      return;
  }
}

class DriverHere final : public Driver {
 public:
  explicit DriverHere(int port) : port_(port), other_(::open("/dev/null", O_RDWR | O_CLOEXEC)) {
    if (!other_) throw_errno("/dev/null");
  }

  std::vector<double> take(const Measure& measure) override {
    std::vector<double> times;
    times.reserve(measure.count);
    for (std::uint32_t i = 0; i < measure.warmup; ++i) act(measure, port_, other_.get(), i);
    for (std::uint32_t i = 0; i < measure.count; ++i) {
      const std::int64_t start = now_ns();
      for (std::uint32_t call = 0; call < measure.calls; ++call) act(measure, port_, other_.get(), i);
      times.push_back(static_cast<double>(now_ns() - start) / 1000.0 / measure.calls);
    }
    return times;
  }

 private:
  int port_;
  UniqueFd other_;
};

// Both ways by pipes with names. Opened for reading and writing: neither end waits for the other to open.
class DriverElsewhere final : public Driver {
 public:
  explicit DriverElsewhere(const std::filesystem::path& dir)
      : ask_(::open((dir / "ask").c_str(), O_RDWR | O_CLOEXEC)),
        answer_(::open((dir / "answer").c_str(), O_RDWR | O_CLOEXEC)) {
    if (!ask_ || !answer_) throw_errno(dir.string());
  }
  ~DriverElsewhere() override {
    const Measure end{};
    (void)!::write(ask_.get(), &end, sizeof end);
  }

  std::vector<double> take(const Measure& measure) override {
    std::vector<double> times(measure.count);
    write_all(ask_.get(), reinterpret_cast<const Byte*>(&measure), sizeof measure);
    read_exact(answer_.get(), reinterpret_cast<Byte*>(times.data()), times.size() * sizeof(double));
    return times;
  }

 private:
  UniqueFd ask_;
  UniqueFd answer_;
};

}  // namespace

std::unique_ptr<Driver> Driver::here(int port) { return std::make_unique<DriverHere>(port); }

std::unique_ptr<Driver> Driver::elsewhere(const std::filesystem::path& dir) {
  return std::make_unique<DriverElsewhere>(dir);
}

void Driver::prepare(const std::filesystem::path& dir) {
  for (const char* name : {"ask", "answer"}) {
    if (::mkfifo((dir / name).c_str(), 0600) != 0) throw_errno((dir / name).string());
  }
}

int drive_command(const Arguments& arguments) {
  CommandLine line(
      "A driver that does what `linebench rtt` or `linebench calls` asks of it, until that is enough.\n"
      "Usage: linebench drive PORT DIR      DIR: {dir} of that program's --driven\n",
      "words");
  line.option()("words", po::value<Arguments>(), "the port, and the folder");
  if (!line.parse(arguments)) return 0;
  const Arguments words = line.list("words");
  if (words.size() != 2) throw UsageError("expected PORT and DIR; see linebench drive --help");
  const std::filesystem::path dir = words[1];
  const UniqueFd ask(::open((dir / "ask").c_str(), O_RDWR | O_CLOEXEC));
  const UniqueFd answer(::open((dir / "answer").c_str(), O_RDWR | O_CLOEXEC));
  if (!ask || !answer) throw_errno(dir.string());
  const UniqueFd port = open_port(words[0]);
  DriverHere driver(port.get());
  for (;;) {
    Measure measure;
    read_exact(ask.get(), reinterpret_cast<Byte*>(&measure), sizeof measure);
    if (measure.count == 0) return 0;
    const std::vector<double> times = driver.take(measure);
    write_all(answer.get(), reinterpret_cast<const Byte*>(times.data()), times.size() * sizeof(double));
  }
}

}  // namespace porttape::bench
