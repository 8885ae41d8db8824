#include "tests/simulation/seed.hpp"

#include <cerrno>
#include <csignal>
#include <exception>
#include <map>
#include <memory>
#include <optional>

#include "daemon/control_protocol.hpp"
#include "daemon/daemon.hpp"
#include "tests/simulation/catalog.hpp"
#include "tests/simulation/connections_channel.hpp"
#include "tests/simulation/disk.hpp"
#include "tests/simulation/live_channel.hpp"
#include "tests/simulation/replay_channel.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::minutes;
using std::chrono::seconds;

// All ends are bounded: 5 s without progress, 10 s for a disk, and a moment for each step.
constexpr Nanos kEndLimit = seconds(60);
// While nothing happens.
constexpr std::uint64_t kMostWakeUps = 30;  // a minute

// The daemon's life: trouble, maybe a calm minute, the end.
class Life {
 public:
  Life(World& world, std::vector<std::unique_ptr<Channel>>& channels)
      : world_(&world), channels_(&channels) {}

  void plan() {
    const Nanos trouble = world_->some_time(seconds(30)) + seconds(1);
    for (auto signals = world_->between(0, 3); signals > 0; --signals) {
      world_->after(Nanos(world_->between(0, trouble.count())), [this] { signal(SIGUSR1); });
    }
    for (auto steps = world_->between(0, 2); steps > 0; --steps) {
      world_->after(Nanos(world_->between(0, trouble.count())), [this] {
        const Nanos by = (world_->chance(0.5) ? 1 : -1) * world_->some_time(std::chrono::hours(10'000));
        world_->trace("the wall clock is set, by {} s", std::chrono::duration_cast<seconds>(by).count());
        world_->kernel().step_clock(by);
      });
    }
    if (world_->chance(0.1)) {
      world_->after(Nanos(world_->between(0, trouble.count())), [this] {
        world_->trace("no thread is to be had");
        world_->kernel().refuse_threads(true);
      });
    }
    for (const auto& channel : *channels_) channel->start();
    if (world_->chance(0.6)) {
      world_->after(trouble, [this] { calm(); });
    } else {
      world_->after(trouble, [this] { end(); });
    }
  }

  [[nodiscard]] bool calms() const { return calms_; }
  // Its tape is looked at four times a second then.
  void disk_hangs() { disk_hangs_ = true; }
  // A disk may begin to hang.
  [[nodiscard]] bool is_young() const { return world_->kernel().now() - begun_ < minutes(10); }

 private:
  void signal(int number) {
    world_->trace("signal {}", number);
    if (number == SIGTERM) world_->end_wanted();
    std::raise(number);
  }

  void calm() {
    world_->trace("calm");
    calms_ = true;
    world_->kernel().refuse_threads(false);
    for (const auto& channel : *channels_) channel->calm();
    world_->after(minutes(1), [this] { wake_ups_ = world_->kernel().wake_ups(); });
    world_->after(minutes(2), [this] {
      const std::uint64_t woken = world_->kernel().wake_ups() - wake_ups_;
      const bool by_world =
          std::ranges::any_of(*channels_, [](const auto& channel) { return channel->looks_on(); });
      if (woken > kMostWakeUps && !disk_hangs_ && !by_world)
        world_->wrong("{} wake-ups in a calm minute", woken);
      for (const auto& channel : *channels_) channel->check_calm();
      end();
    });
  }

  void end() {
    signal(SIGTERM);
    if (world_->chance(0.2)) world_->after(world_->some_time(seconds(5)), [this] { signal(SIGTERM); });
    world_->after(kEndLimit, [this] {
      world_->wrong("the daemon has not ended {} s after SIGTERM",
                    std::chrono::duration_cast<seconds>(kEndLimit).count());
      world_->loop().stop();
    });
  }

  World* world_;
  std::vector<std::unique_ptr<Channel>>* channels_;
  Instant begun_ = world_->kernel().now();
  std::uint64_t wake_ups_ = 0;
  bool calms_ = false;
  bool disk_hangs_ = false;
};

// Longer than a daemon lives after SIGTERM, and less than the kernel waits for its threads.
constexpr Nanos kHangs = minutes(20);

Disk::Trouble disk_trouble(World& world, Life& life, double rate, bool hangs) {
  Disk::Trouble trouble;
  // The loop's own thread may find a disk slow once, and waits for it then: it meets no disk that hangs.
  if (hangs && life.is_young() && !life.calms() && world.kernel().on_worker() && world.chance(0.02)) {
    trouble.takes = kHangs;
    life.disk_hangs();
    return trouble;
  }
  if (life.calms() || !world.chance(rate)) return trouble;
  switch (world.between(0, 3)) {
    case 0:
      trouble.takes = world.some_time(seconds(8));
      break;
    case 1:
      trouble.error = world.chance(0.5) ? ENOSPC : EIO;
      break;
    case 2:
      trouble.most_bytes = static_cast<std::size_t>(world.between(1, 40));
      break;
    default:
      trouble.takes = std::chrono::milliseconds(world.between(1, 20));
  }
  return trouble;
}

void live(World& world, bool disk_fails) {
  std::vector<std::unique_ptr<Channel>> channels;
  std::map<std::string, ChannelSpec> specs;
  for (auto count = world.between(1, 3); count > 0; --count) {
    // With one channel alone the log has no channel's name.
    const std::string name = fmt::format("ch{}", count);
    if (world.chance(0.3)) {
      channels.push_back(std::make_unique<ReplayChannel>(world, name, disk_fails));
    } else if (world.chance(0.15)) {
      channels.push_back(std::make_unique<ConnectionsChannel>(world, name, world.chance(0.8), disk_fails));
    } else {
      channels.push_back(std::make_unique<LiveChannel>(world, name, world.chance(0.8), disk_fails));
    }
    specs[name] = channels.back()->spec();
  }
  int status = 0;
  {
    std::optional<Daemon> daemon;
    daemon.emplace(world.loop(), specs.size() > 1 ? world.log() : world.log()->clone(specs.begin()->first),
                   Daemon::Options{.keeps_channels = true});
    Life life(world, channels);
    const double rate = world.chance(0.5) ? 0.02 : 0.3;
    const bool hangs = disk_fails && world.chance(0.2);
    std::optional<Disk> disk;
    disk.emplace([&](Disk::Call call) {
      const Disk::Trouble trouble = disk_fails ? disk_trouble(world, life, rate, hangs) : Disk::Trouble{};
      if (trouble.error != 0 || trouble.takes.count() > 0 || trouble.most_bytes != ~std::size_t{0})
        world.trace("disk: {} takes {} ms, error {}, {} bytes", name_of(call),
                    trouble.takes.count() / 1'000'000, trouble.error,
                    static_cast<std::int64_t>(trouble.most_bytes));
      return trouble;
    });
    if (const Result<void> started = daemon->start(specs); !started) {
      world.wrong("the daemon does not start: {}", started.error().message);
      return;
    }
    world.control = [&daemon](std::string_view line) { return control_reply(*daemon, line); };
    life.plan();
    try {
      status = daemon->run();
    } catch (const WaitsForEver&) {
      world.wrong("the daemon waits for ever");
    } catch (const std::exception& error) {
      world.wrong("an exception leaves the loop: {}", error.what());
    }
    world.trace("the daemon has ended with status {}", status);
    world.control = nullptr;
    daemon.reset();
    world.close_loop();
  }
  if (!world.trouble().empty()) return;
  for (const auto& channel : channels) channel->check_end(status != 0);
}

}  // namespace

SeedResult run_seed(std::uint64_t seed, const std::filesystem::path& folder, bool tracing) {
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  SeedResult result;
  {
    World world(seed, folder, tracing);
    live(world, world.chance(0.4));
    result.trouble = world.trouble();
    result.trace = world.told();
    result.seconds = std::chrono::duration<double>(world.kernel().passed()).count();
  }
  take_down_lines();
  return result;
}

}  // namespace porttape::simulation
