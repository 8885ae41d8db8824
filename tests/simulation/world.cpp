#include "tests/simulation/world.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <spdlog/details/null_mutex.h>
#include <spdlog/sinks/base_sink.h>

namespace porttape::simulation {

class World::LogSink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  explicit LogSink(World& world) : world_(&world) {}

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    std::string line = fmt::format("{}: {}", message.logger_name, message.payload);
    if (line.find("an error of this program") != std::string::npos) world_->wrong("log: {}", line);
    world_->trace("log: {}", line);
    world_->logged_.push_back(std::move(line));
  }
  void flush_() override {}

  World* world_;
};

// One timer for all that the world does.
struct World::Later {
  explicit Later(Loop& on) : loop(on), timer(on, [this] { run(); }) {}
  void run() {
    while (!due.empty() && due.begin()->first <= loop.now()) {
      const auto first = due.extract(due.begin());
      first.mapped()();
    }
    if (!due.empty()) timer.set(due.begin()->first);
  }
  Loop& loop;
  std::multimap<Instant, std::function<void()>> due;
  Timer timer;
};

World::World(std::uint64_t seed, std::filesystem::path folder, bool tracing)
    : kernel_(seed),
      folder_(std::move(folder)),
      tracing_(tracing),
      loop_(std::make_unique<Loop>(kernel_, kernel_)),
      log_(std::make_shared<spdlog::logger>("channel", std::make_shared<LogSink>(*this))),
      later_(std::make_unique<Later>(*loop_)) {
  log_->set_level(spdlog::level::debug);
}

World::~World() = default;

void World::close_loop() {
  later_.reset();
  loop_.reset();
  if (!kernel_.run_down()) wrong("a thread of the program does not end");
}

Nanos World::some_time(Nanos most) {
  const double exponent =
      static_cast<double>(between(0, 1'000'000)) / 1e6 * std::log(static_cast<double>(most.count()) / 1e3);
  return Nanos(static_cast<std::int64_t>(std::exp(exponent) * 1e3));
}

Bytes World::some_bytes(std::size_t size) {
  Bytes bytes(size);
  std::uint64_t word = 0;
  for (std::size_t n = 0; n < size; ++n) {
    if (n % 8 == 0) word = kernel_.random()();
    bytes[n] = static_cast<Byte>(word >> (n % 8 * 8));
  }
  return bytes;
}

void World::after(Nanos time, std::function<void()> what) {
  const Instant when = loop_->now() + time;
  later_->due.emplace(when, std::move(what));
  if (later_->due.begin()->first == when) later_->timer.set(when);
}

void World::note(std::string line) {
  const double seconds = std::chrono::duration<double>(kernel_.passed()).count();
  trace_.push_back(fmt::format("{:12.6f}  {}", seconds, line));
}

void World::found(std::string what) {
  if (trouble_.empty()) trouble_ = what;
  trace("WRONG: {}", what);
}

}  // namespace porttape::simulation
