#pragma once

#include <iosfwd>
#include <map>
#include <memory>
#include <string>

namespace porttape {

// What came of a run against a tape.
struct TapeVerdict {
  bool passed = false;
  int exit_status = 1;  // 0 pass, 3 other data, 4 other timing, 5 incomplete, 1 and 2: there was no run
  std::string text;     // the report for a person
  std::string json;     // the same as tools/OUTPUT.md has it

  explicit operator bool() const { return passed; }
};
std::ostream& operator<<(std::ostream& out, const TapeVerdict& verdict);  // its text

// A tape in a device's place, for a test in whatever framework: a port to give to the driver, and the
// verdict.
//
//   porttape::TapeDevice device("tapes/laser");
//   Laser laser(device.port());
//   EXPECT_EQ(laser.distance(), 608);
//   EXPECT_TRUE(device.verdict()) << device.verdict();   // Catch2: INFO(device.verdict());
//   CHECK(device.verdict());
//
// The tape plays on a thread of its own, from the constructor until verdict() or the destructor. The options
// are those of `porttape test` without their dashes: {{"strictness", "2"}, {"driver",
// "tcp-listen:127.0.0.1:0"}}. Any thread, one at a time.
class TapeDevice {
 public:
  using Options = std::map<std::string, std::string>;

  // std::runtime_error: no such tape, a wrong option, no port to be had; what() says what to do.
  explicit TapeDevice(const std::string& tape, const Options& options = {});
  ~TapeDevice();
  TapeDevice(const TapeDevice&) = delete;
  TapeDevice& operator=(const TapeDevice&) = delete;

  // What the driver is to open: the path of a tty, or HOST:PORT of a socket, of which the others are parts.
  [[nodiscard]] const std::string& port() const;
  [[nodiscard]] const std::string& host() const;
  [[nodiscard]] unsigned tcp_port() const;

  // Ends the run, whoever still has the port, and says what came of it; later calls say the same. It waits
  // for what is on its way, some seconds at most.
  const TapeVerdict& verdict();

 private:
  class Player;
  std::unique_ptr<Player> player_;
};

}  // namespace porttape
