#include "tests/bench/rig.hpp"

#include <cstdlib>
#include <sstream>
#include <utility>
#include <vector>

#include "tests/bench/tcp_line.hpp"

namespace porttape::bench {
namespace {

constexpr int kPortMs = 10'000;

std::string filled(std::string text, const std::string& key, const std::string& value) {
  for (std::size_t at = 0; (at = text.find(key, at)) != std::string::npos; at += value.size()) {
    text.replace(at, key.size(), value);
  }
  return text;
}

}  // namespace

RelaySpec parse_relay(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw UsageError("'" + text + "': expected NAME=COMMAND, or NAME= for the bare pty");
  }
  return {text.substr(0, equals), text.substr(equals + 1)};
}

ScratchDir::ScratchDir() {
  std::string path = (std::filesystem::temp_directory_path() / "linebench-XXXXXX").string();
  if (::mkdtemp(path.data()) == nullptr) throw_errno(path);
  path_ = path;
}

ScratchDir::~ScratchDir() {
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
}

Rig::Rig(RelaySpec spec)
    : spec_(std::move(spec)), tcp_(spec_.command.find("{driver_port}") != std::string::npos) {}

Rig::~Rig() {
  if (dir().empty()) return;  // moved from
  driver_.reset();
  relay_.stop();
}

std::string Rig::driver_path() const { return makes_port() ? (dir() / "driver").string() : device_.slave; }

std::string Rig::output_tail() const { return last_lines(dir() / "output"); }

void Rig::start() {
  if (tcp_) {
    listener_ = listen_tcp();
    connection_.reset();
    driver_port_ = free_tcp_port();
  } else {
    device_ = make_pty();
  }
  if (!has_process()) return;
  std::vector<std::string> argv;
  std::istringstream words(spec_.command);
  for (std::string word; words >> word;) {
    word = filled(filled(word, "{driver}", driver_path()), "{device}", device_.slave);
    if (tcp_) {
      word = filled(word, "{driver_port}", std::to_string(driver_port_));
      word = filled(word, "{device_port}", std::to_string(tcp_port(listener_.get())));
    }
    argv.push_back(filled(word, "{dir}", dir().string()));
  }
  relay_ = Child::run(argv, (dir() / "output").string());
  if (tcp_ || !makes_port()) return;
  for (int waited = 0; !std::filesystem::exists(driver_path()); waited += 2) {
    if (relay_.poll()) throw BenchError(name() + " ended at start: " + output_tail());
    if (waited > kPortMs) throw BenchError(name() + " made no driver port: " + output_tail());
    sleep_ms(2);
  }
}

void Rig::open_driver() { driver_ = tcp_ ? connect_tcp(driver_port_, kPortMs) : open_port(driver_path()); }

int Rig::device() {
  if (!tcp_) return device_.master.get();
  if (!connection_) connection_ = accept_tcp(listener_.get());
  return connection_.get();
}

void Rig::handshake() {
  const Watchdog watchdog(10, name() + ": first bytes through the line");
  Byte zeros[kHandshake]{};
  write_all(driver(), zeros, kHandshake);
  read_exact(device(), zeros, kHandshake);
  write_all(device(), zeros, kHandshake);
  read_exact(driver(), zeros, kHandshake);
}

int Rig::stop() {
  driver_.reset();
  const int status = relay_.stop();
  std::error_code ignored;
  std::filesystem::remove(dir() / "driver", ignored);
  return status;
}

int Rig::wait() {
  driver_.reset();
  const Watchdog watchdog(10, name() + ": the relay's end");
  return relay_.wait();
}

}  // namespace porttape::bench
