#pragma once

#include <cstdint>
#include <filesystem>
#include <fmt/format.h>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <spdlog/logger.h>

#include "libport/base/bytes.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "tests/simulation/kernel.hpp"

namespace porttape::simulation {

// One seed's world: chance, what happens when, and what was found wrong.
class World {
 public:
  World(std::uint64_t seed, std::filesystem::path folder, bool tracing);
  ~World();

  Kernel& kernel() { return kernel_; }
  Loop& loop() { return *loop_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  // What the program logs: traced, and looked at.
  std::shared_ptr<spdlog::logger> log() { return log_; }
  [[nodiscard]] const std::vector<std::string>& logged() const { return logged_; }

  bool chance(double probability) { return static_cast<double>(between(0, 999'999)) < probability * 1e6; }
  std::int64_t between(std::int64_t least, std::int64_t most) {
    return least +
           static_cast<std::int64_t>(kernel_.random()() % static_cast<std::uint64_t>(most - least + 1));
  }
  // Mostly short ones, and each order of magnitude up to `most` as often.
  Nanos some_time(Nanos most);
  Bytes some_bytes(std::size_t size);
  // Another one each time: in the order in which they are asked for.
  std::uint64_t next_number() { return ++numbers_; }

  // The daemon's end was wanted: when, each time.
  void end_wanted() { ends_.push_back(loop_->now()); }
  [[nodiscard]] const std::vector<Instant>& ends() const { return ends_; }

  // Calls from the loop, after this time.
  void after(Nanos time, std::function<void()> what);

  template <class... Args>
  void trace(fmt::format_string<Args...> text, Args&&... args) {
    if (tracing_) note(fmt::format(text, std::forward<Args>(args)...));
  }
  // Something that must never be.
  template <class... Args>
  void wrong(fmt::format_string<Args...> text, Args&&... args) {
    found(fmt::format(text, std::forward<Args>(args)...));
  }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }  // the first; empty: none
  [[nodiscard]] const std::vector<std::string>& told() const { return trace_; }

  // Gives a line to the daemon's control socket, and what it answers. Empty while there is no daemon.
  std::function<std::string(std::string_view)> control;

  // Ends the loop and the program's threads, so that the rest can be looked at.
  void close_loop();

 private:
  class LogSink;
  void note(std::string line);
  void found(std::string what);

  Kernel kernel_;
  std::filesystem::path folder_;
  const bool tracing_;
  std::vector<std::string> trace_;
  std::vector<std::string> logged_;
  std::string trouble_;
  std::uint64_t numbers_ = 0;
  std::vector<Instant> ends_;
  std::unique_ptr<Loop> loop_;
  std::shared_ptr<spdlog::logger> log_;
  struct Later;
  std::unique_ptr<Later> later_;
};

}  // namespace porttape::simulation
