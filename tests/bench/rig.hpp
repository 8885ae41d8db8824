#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include "tests/bench/child.hpp"
#include "tests/bench/line.hpp"

namespace porttape::bench {

// A line under test: NAME=COMMAND, where {driver} is the link the relay must make, {device} the device's path
// and {dir} a folder of its own; or {driver_port} the TCP port of 127.0.0.1 where it must listen and
// {device_port} the one where the device does. An empty COMMAND is the bare pty: the driver opens the device
// itself.
struct RelaySpec {
  std::string name;
  std::string command;
};
RelaySpec parse_relay(const std::string& text);

// A folder that goes away with all it holds.
class ScratchDir {
 public:
  ScratchDir();
  ScratchDir(ScratchDir&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  ScratchDir& operator=(ScratchDir&&) = delete;
  ~ScratchDir();
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Device (a pty or a TCP server), relay process and the driver's open port. Owns them and a folder.
//
// start(), open_driver(), use driver() and device(), stop(); then start() again if wanted.
class Rig {
 public:
  explicit Rig(RelaySpec spec);
  Rig(Rig&&) noexcept = default;
  Rig& operator=(Rig&&) = delete;
  ~Rig();

  void start();  // until the driver's port is there (TCP: open_driver() waits for it)
  void open_driver();
  void close_driver() { driver_.reset(); }
  void handshake();  // kHandshake zero bytes both ways: the relay has opened the device and moves bytes
  int stop();        // the driver closes, the relay ends; its exit status
  int wait();        // as stop(), for a relay that ends by itself

  [[nodiscard]] const std::string& name() const { return spec_.name; }
  [[nodiscard]] const std::filesystem::path& dir() const { return dir_.path(); }
  [[nodiscard]] std::string driver_path() const;
  [[nodiscard]] int driver() const { return driver_.get(); }
  // Over TCP it waits for the relay's connection when first asked for, in whichever process that is.
  [[nodiscard]] int device();
  [[nodiscard]] bool has_process() const { return !spec_.command.empty(); }
  // Else the driver has the device itself.
  [[nodiscard]] bool makes_port() const { return spec_.command.find("{driver}") != std::string::npos; }
  [[nodiscard]] pid_t pid() const { return relay_.pid(); }
  [[nodiscard]] bool alive() { return has_process() && !relay_.poll(); }
  [[nodiscard]] std::int64_t relay_cpu_ns() const { return has_process() ? cpu_ns(pid()) : 0; }

  static constexpr std::size_t kHandshake = 16;

 private:
  [[nodiscard]] std::string output_tail() const;

  RelaySpec spec_;
  ScratchDir dir_;
  bool tcp_;
  UniqueFd listener_;  // TCP: the device's, and its connection
  UniqueFd connection_;
  std::uint16_t driver_port_ = 0;
  Pty device_;
  UniqueFd driver_;
  Child relay_;
};

}  // namespace porttape::bench
