// A real recording, read from its files: a laser scanner's session, made by another recorder one byte at a
// time.

#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "libport/replay/engine.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {
namespace {

// Plays a tape to a driver that does what the tape's driver did.
class Playback {
 public:
  Playback(const TapePaths& paths, const ReplayConfig& config)
      : script_(TapeReader::open(paths).value()),
        schedule_(TapeReader::open(paths).value()),
        writes_(TapeReader::open(paths, TapeReader::Select::writes_only).value()),
        engine_(config, {.totals = TapeTotals{3222, 42}}, schedule_, writes_) {}

  RunReport run() {
    engine_.on_open(now_);
    std::string expected;
    while (auto record = script_.next().value()) {
      if (record->kind == RecordKind::read) expected += as_text(record->data);
      if (record->kind != RecordKind::write) continue;
      await(expected.size());
      engine_.on_write(now_, record->data);
      take();
    }
    await(expected.size());
    EXPECT_EQ(delivered_, expected);
    engine_.on_close(now_);
    return engine_.advance(now_).run_ended.value();
  }

  [[nodiscard]] int deliveries() const { return deliveries_; }

 private:
  void await(std::size_t bytes) {
    while (delivered_.size() < bytes) {
      ASSERT_TRUE(engine_.next_deadline()) << "stalled at byte " << delivered_.size();
      now_ = std::max(now_, *engine_.next_deadline());
      take();
    }
  }

  void take() {
    const ReplayActions actions = engine_.advance(now_);
    delivered_ += as_text(actions.deliver);
    deliveries_ += actions.deliver.empty() ? 0 : 1;
  }

  TapeReader script_;
  TapeReader schedule_;
  TapeReader writes_;
  Engine engine_;
  Instant now_{};
  std::string delivered_;
  int deliveries_ = 0;
};

TEST(Recording, LaserScannerSessionPlaysInItsTenBursts) {
  const TapePaths paths = literal_tape(PORTTAPE_SHARED_DIR "/recordings/urg_04lx.log");
  if (!std::filesystem::exists(paths.read)) GTEST_SKIP() << "there is no recording " << paths.read;
  for (const Timing timing : {Timing::reactive, Timing::none}) {
    ReplayConfig config;
    config.on_mismatch = OnMismatch::fail;
    config.timing = timing;
    Playback playback(paths, config);
    const RunReport report = playback.run();
    EXPECT_EQ(report.verdict, Verdict::pass) << to_text(report);
    EXPECT_EQ(report.to_driver_bytes, 3222U);
    EXPECT_EQ(report.to_driver_of, 3222U);
    EXPECT_EQ(report.from_driver_matched, 42U);
    EXPECT_EQ(report.from_driver_of, 42U);
    EXPECT_EQ(playback.deliveries(), 10);
  }
}

}  // namespace
}  // namespace porttape
