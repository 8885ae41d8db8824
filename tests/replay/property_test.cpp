// What holds for every tape and every pace: seeded random tapes, played to drivers at random pace.

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"
#include "tests/support/random_tape.hpp"

namespace porttape::test {
namespace {

constexpr int kSeeds = 400;

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}
  std::uint32_t operator()(std::uint32_t n) { return n == 0 ? 0 : static_cast<std::uint32_t>(random_() % n); }

 private:
  std::mt19937_64 random_;
};

// A driver that does what the tape's did: waits for what was read, writes what was written, closes and opens
// likewise.
class PerfectDriver {
 public:
  PerfectDriver(Rig& rig, const MemoryTape& tape, Dice& dice) : rig_(rig), tape_(tape), dice_(dice) {}

  bool bytewise = false;
  bool pipelined = false;                   // does not wait for answers before it writes on
  std::size_t change_at = ~std::size_t{0};  // writes another byte at this offset
  std::size_t stop_at = ~std::size_t{0};    // writes no more from this offset on

  // False when the line hung up or what was to come did not.
  bool run() {
    if (tape_.opens() == 0) rig_.open();
    for (const auto& entry : tape_.entries()) {
      if (rig_.hung_up || stopped_) break;
      if (!step(entry)) return false;
    }
    if (rig_.hung_up) return false;
    if (!await()) return false;
    if (open_ || tape_.opens() == 0) rig_.close();
    return true;
  }

 private:
  bool step(const MemoryTape::Entry& entry) {
    switch (entry.kind) {
      case RecordKind::open:
        rig_.open();
        open_ = true;
        break;
      case RecordKind::close:
        if (!await()) return false;
        rig_.close();
        open_ = false;
        if (dice_(2) == 0) rig_.stall(dice_(100'000));
        break;
      case RecordKind::read:
        expected_ += entry.data.size();
        break;
      case RecordKind::write:
        if (!pipelined && !await()) return false;
        write(entry.data);
        break;
      case RecordKind::hang_up:
      case RecordKind::half_close:
      case RecordKind::gap:
        break;
      case RecordKind::event:
        if (const auto* settings = std::get_if<event::Settings>(&entry.event);
            settings != nullptr && settings->by == Side::driver) {
          rig_.set(settings->line);
        }
        break;
    }
    return true;
  }

  void write(std::string data) {
    for (char& byte : data) {
      if (written_ == stop_at) {
        stopped_ = true;
        data.resize(static_cast<std::size_t>(&byte - data.data()));
        break;
      }
      if (written_++ == change_at) byte = static_cast<char>(byte + 7);
    }
    std::size_t done = 0;
    while (done < data.size() && !rig_.hung_up) {
      const std::size_t size = bytewise ? 1 : 1 + dice_(static_cast<std::uint32_t>(data.size() - done));
      rig_.write(std::string_view(data).substr(done, size));
      done += size;
      if (dice_(3) == 0) pass_time();
    }
  }

  bool await() {
    for (int i = 0; rig_.delivered.size() < expected_ && !stopped_; ++i) {
      if (i > 10'000) return false;
      pass_time();
    }
    return true;
  }

  void pass_time() { dice_(2) == 0 ? rig_.wait(dice_(20'000)) : rig_.stall(dice_(20'000)); }

  Rig& rig_;
  const MemoryTape& tape_;
  Dice& dice_;
  bool open_ = false;
  bool stopped_ = false;
  std::size_t expected_ = 0;
  std::size_t written_ = 0;
};

ReplayConfig random_config(Dice& dice) {
  ReplayConfig config;
  config.on_mismatch = OnMismatch::fail;
  config.check_settings = true;
  config.timing = dice(3) == 0 ? Timing::none : Timing::reactive;
  config.rate = std::vector<double>{0.5, 1, 1, 3, 10}[dice(5)];
  config.chunks = std::vector{Chunks::automatic, Chunks::automatic, Chunks::bytes, Chunks::random}[dice(4)];
  config.chunk_seed = dice(1000);
  return config;
}

TEST(Property, APerfectDriverPassesAndGetsEverythingInOrder) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    const MemoryTape tape = random_tape(dice, {.sessions = seed % 3 == 0});
    Rig rig(tape, random_config(dice), dice(2) == 0, 1 + dice(9));
    rig.max_bytes = 1 + dice(20);
    PerfectDriver driver(rig, tape, dice);
    driver.bytewise = dice(3) == 0;
    driver.pipelined = dice(3) == 0;
    ASSERT_TRUE(driver.run());
    ASSERT_EQ(rig.delivered, tape.all(RecordKind::read));
    ASSERT_EQ(rig.finish_unless_ended(), Verdict::pass);
    ASSERT_EQ(rig.runs, 1);
    EXPECT_EQ(rig.report->from_driver_matched, rig.report->from_driver_of);
    EXPECT_EQ(rig.report->to_driver_bytes, rig.report->to_driver_of);
    EXPECT_EQ(rig.report->settings.made, rig.report->settings.recorded);
  }
}

TEST(Property, AnyOneChangedByteIsAMismatchAtItsOffset) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    const MemoryTape tape = random_tape(dice, {.sessions = seed % 3 == 0});
    const std::size_t bytes = tape.all(RecordKind::write).size();
    if (bytes == 0) continue;
    const std::size_t offset = dice(static_cast<std::uint32_t>(bytes));
    const ReplayConfig config = random_config(dice);
    for (const bool bytewise : {false, true}) {
      Rig rig(tape, config, true, 1 + dice(9));
      PerfectDriver driver(rig, tape, dice);
      driver.bytewise = bytewise;
      driver.change_at = offset;
      ASSERT_FALSE(driver.run());
      ASSERT_EQ(rig.verdict(), Verdict::data_mismatch);
      ASSERT_EQ(rig.report->mismatch->offset, offset);
      ASSERT_EQ(rig.report->from_driver_matched, offset);
      ASSERT_EQ(tape.all(RecordKind::read).substr(0, rig.delivered.size()), rig.delivered);
    }
  }
}

TEST(Property, ADriverThatStopsEarlyIsIncomplete) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    const MemoryTape tape = random_tape(dice, {.sessions = seed % 3 == 0});
    const std::string writes = tape.all(RecordKind::write);
    if (writes.empty()) continue;
    Rig rig(tape, random_config(dice));
    PerfectDriver driver(rig, tape, dice);
    driver.stop_at = dice(2) == 0 ? writes.size() - 1 : dice(static_cast<std::uint32_t>(writes.size()));
    ASSERT_TRUE(driver.run());
    ASSERT_EQ(rig.finish_unless_ended(), Verdict::incomplete);
    EXPECT_EQ(rig.report->next_expected_offset, driver.stop_at);
    EXPECT_EQ(as_text(rig.report->next_expected), writes.substr(driver.stop_at, 32));
  }
}

// For every byte delivered: all writes before it on the tape had come, and not less than the recorded gap
// before.
TEST(Property, NothingIsEverEarly) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    const MemoryTape tape = random_tape(dice);
    const ReplayConfig config = random_config(dice);
    Rig rig(tape, config, true, 1 + dice(9));
    rig.open();

    // Writes the whole stream with random pauses, noting when each byte was written.
    std::vector<std::int64_t> written_us;
    for (const char byte : tape.all(RecordKind::write)) {
      if (dice(2) == 0) dice(2) == 0 ? rig.wait(dice(30'000)) : rig.stall(dice(30'000));
      written_us.push_back(rig.now_us());
      rig.write({&byte, 1});
    }
    rig.wait(100'000'000);
    ASSERT_EQ(rig.delivered, tape.all(RecordKind::read));

    std::vector<std::int64_t> delivered_us;
    for (const auto& delivery : rig.deliveries)
      delivered_us.insert(delivered_us.end(), delivery.bytes.size(), delivery.us);
    std::size_t writes = 0;
    std::size_t reads = 0;
    std::int64_t anchor_tape = 0;
    std::int64_t anchor_real = 0;
    for (const auto& entry : tape.entries()) {
      if (entry.kind == RecordKind::write && !entry.data.empty()) {
        writes += entry.data.size();
        anchor_tape = entry.us;
        anchor_real = written_us.at(writes - 1);
      } else if (entry.kind == RecordKind::read) {
        const double gap =
            config.timing == Timing::none ? 0 : static_cast<double>(entry.us - anchor_tape) / config.rate;
        for (std::size_t i = 0; i < entry.data.size(); ++i) {
          EXPECT_GE(static_cast<double>(delivered_us.at(reads++)) + 1,
                    static_cast<double>(anchor_real) + gap);
        }
      }
    }
  }
}

// The requests of a tape of one session, each with its answers in turn.
using Exchanges = std::map<std::string, std::vector<std::string>>;
Exchanges exchanges_of(const MemoryTape& tape) {
  Exchanges found;
  std::string request;
  std::string* answer = nullptr;
  for (const auto& entry : tape.entries()) {
    if (entry.kind == RecordKind::write && !entry.data.empty()) {
      if (answer != nullptr) request.clear();
      request += entry.data;
      answer = nullptr;
    } else if (entry.kind == RecordKind::read && !entry.data.empty()) {
      if (answer == nullptr && !request.empty()) answer = &found[request].emplace_back();
      if (answer != nullptr) *answer += entry.data;
    }
  }
  if (answer == nullptr && !request.empty()) found[request].emplace_back();
  return found;
}

void write_in_pieces(Rig& rig, Dice& dice, std::string_view text) {
  while (!text.empty()) {
    const std::size_t size = 1 + dice(static_cast<std::uint32_t>(text.size()));
    rig.write(text.substr(0, size));
    text.remove_prefix(size);
  }
}

TEST(Property, UnderLookupAnyRequestIsAnsweredInRecordedOrderThenTheLastAgain) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    const MemoryTape tape = random_tape(dice);
    const Exchanges exchanges = exchanges_of(tape);
    if (exchanges.empty()) continue;
    ReplayConfig config = random_config(dice);
    config.check_settings = false;
    config.match = Match::lookup;
    Rig rig(tape, config, dice(2) == 0, 1 + dice(9));
    rig.max_bytes = 1 + dice(20);
    rig.open().wait(10'000'000).read();  // what nobody asked for
    std::map<std::string, std::size_t> asked;
    for (int i = 0; i < 40; ++i) {
      const auto& [request, answers] =
          *std::next(exchanges.begin(), dice(static_cast<std::uint32_t>(exchanges.size())));
      write_in_pieces(rig, dice, request);
      rig.wait(10'000'000);
      ASSERT_EQ(rig.read(), answers[std::min(asked[request]++, answers.size() - 1)]) << "to " << request;
    }
    rig.close();
    ASSERT_EQ(rig.verdict(), Verdict::pass);
    EXPECT_EQ(rig.report->lookup->requests, exchanges.size());
    EXPECT_EQ(rig.report->lookup->asked, asked.size());
    EXPECT_EQ(rig.report->lookup->answered, 40U);
  }
}

TEST(Property, UnderResyncWhateverTheTapeHasIsAnswered) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    MemoryTape tape;
    const std::uint32_t size = 1 + dice(12);
    for (std::uint32_t i = 0; i < size; ++i) {
      const std::string number = std::to_string(i % (1 + dice(12)));
      tape.write(i * 10'000, "q" + number + ";").read(i * 10'000 + dice(5000), "a" + number + ";");
    }
    ReplayConfig config = random_config(dice);
    config.check_settings = false;
    config.on_mismatch = OnMismatch::resync;
    Rig rig(tape, config, true, 1 + dice(4));
    rig.open();
    const Exchanges exchanges = exchanges_of(tape);
    for (int i = 0; i < 20; ++i) {
      if (dice(4) == 0) {
        rig.write("what?;").wait(100'000);
        ASSERT_EQ(rig.read(), "");
        continue;
      }
      const auto& [request, answers] =
          *std::next(exchanges.begin(), dice(static_cast<std::uint32_t>(exchanges.size())));
      write_in_pieces(rig, dice, request);
      rig.wait(10'000'000);
      ASSERT_EQ(rig.read(), answers.front()) << "to " << request;
    }
    EXPECT_EQ(rig.runs, 0);
  }
}

TEST(Property, AtStrictnessZeroEveryDriverGetsEverythingAtLast) {
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    Dice dice(seed);
    const MemoryTape tape = random_tape(dice);
    ReplayConfig config = random_config(dice);
    config.strictness = 0;
    config.check_settings = false;
    Rig rig(tape, config);
    rig.open();
    for (std::uint32_t i = dice(30); i > 0; --i) {
      rig.write(std::string(1 + dice(9), static_cast<char>('a' + dice(3)))).wait(dice(70'000));
    }
    rig.wait(200'000'000);
    ASSERT_EQ(rig.delivered, tape.all(RecordKind::read));
    rig.close();
    ASSERT_EQ(rig.verdict(), Verdict::pass);
  }
}

}  // namespace
}  // namespace porttape::test
