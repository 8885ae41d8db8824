// What the pure layers cost: cutting a tape into blocks, writing one, and the replay engine.

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <benchmark/benchmark.h>

#include "libport/replay/engine.hpp"
#include "libport/tape/block.hpp"
#include "libport/tape/block_file.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tests/bench/pattern.hpp"

namespace porttape::bench {
namespace {

constexpr std::size_t kTapeBytes = 8 << 20;

Bytes blocks_in_memory(std::size_t block_size) {
  Bytes tape;
  for (std::int64_t i = 0; tape.size() < kTapeBytes; ++i) {
    const auto header = encode_header(tape_time_us(i * 10), static_cast<std::uint32_t>(block_size));
    tape.insert(tape.end(), header.begin(), header.end());
    const Byte* payload = pattern_at(static_cast<std::uint64_t>(i) * block_size);
    tape.insert(tape.end(), payload, payload + block_size);
  }
  return tape;
}

void set_bytes(benchmark::State& state, std::size_t bytes_a_round) {
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes_a_round));
}

// The decoder alone, the whole tape in one span.
void decode(benchmark::State& state) {
  const Bytes tape = blocks_in_memory(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) {
    BlockDecoder decoder(Layout::big_endian);
    for (ByteView rest(tape); decoder.next(rest, true) == BlockDecoder::Step::piece;) {
      benchmark::DoNotOptimize(decoder.piece().data.data());
      rest = rest.subspan(decoder.consumed());
    }
  }
  set_bytes(state, tape.size());
}
BENCHMARK(decode)->Arg(64)->Arg(4096);

// With the reader's buffer between it and the bytes, as `porttape verify` reads.
void read_block_file(benchmark::State& state) {
  const Bytes tape = blocks_in_memory(static_cast<std::size_t>(state.range(0)));
  BlockFile file(std::make_unique<MemorySource>("memory", tape), Layout::big_endian,
                 BlockFile::Blocks::in_pieces);
  for (auto _ : state) {
    while (file.next() == BlockFile::Step::piece) benchmark::DoNotOptimize(file.piece().data.data());
    file.rewind();
  }
  set_bytes(state, tape.size());
}
BENCHMARK(read_block_file)->Arg(64)->Arg(4096);

void encode(benchmark::State& state) {
  std::int64_t us = 0;
  for (auto _ : state) benchmark::DoNotOptimize(encode_header(tape_time_us(us += 10), 64));
}
BENCHMARK(encode);

// One recorded block, system call included.
void write_tape(benchmark::State& state) {
  const auto folder = std::filesystem::temp_directory_path();
  const TapePaths paths =
      literal_tape((folder / ("micro-bench-" + std::to_string(state.range(0)) + ".log")).string());
  const auto remove = [&paths] {
    for (const auto& path : {paths.read, paths.write, paths.events}) std::filesystem::remove(path);
  };
  remove();
  Result<TapeWriter> writer = TapeWriter::create(paths, {"micro_bench", "none"}, {.sync = false});
  if (!writer) {
    state.SkipWithError(writer.error().message.c_str());
    return;
  }
  const ByteView data(pattern_at(0), static_cast<std::size_t>(state.range(0)));
  std::int64_t us = 0;
  for (auto _ : state) writer->read_block(tape_time_us(us += 10), data);
  if (Result<void> done = writer->finish(tape_time_us(us)); !done)
    state.SkipWithError(done.error().message.c_str());
  remove();
  set_bytes(state, data.size());
}
BENCHMARK(write_tape)->Arg(16)->Arg(64)->Arg(4096)->Iterations(20000);

// An endless tape in memory: questions and answers of `size` bytes in turn, or one of the two.
class Exchanges final : public RecordSource {
 public:
  Exchanges(std::size_t size, bool questions, bool answers)
      : size_(size), questions_(questions), answers_(answers) {}

  Result<std::optional<Record>> next() override {
    const bool question = questions_ && (!answers_ || number_ % 2 == 0);
    const std::uint64_t turn = questions_ && answers_ ? number_ / 2 : number_;
    Record record;
    record.kind = question ? RecordKind::write : RecordKind::read;
    record.at = tape_time_us(static_cast<std::int64_t>(number_) * 1000);
    record.stream_offset = turn * size_;
    record.data = ByteView(pattern_at(record.stream_offset), size_);
    record.block_length = static_cast<std::uint32_t>(size_);
    ++number_;
    return std::optional<Record>(record);
  }
  Result<void> rewind() override {
    number_ = 0;
    return {};
  }

 private:
  std::size_t size_;
  bool questions_;
  bool answers_;
  std::uint64_t number_ = 0;
};

// Question in, compared, answer out when it is due: one step of a reactive replay. With long ones the
// comparing counts.
void engine_exchange(benchmark::State& state) {
  const auto size = static_cast<std::size_t>(state.range(0));
  Exchanges schedule(size, true, true);
  Exchanges writes(size, true, false);
  Engine engine({}, {.stamped_at_arrival = true}, schedule, writes);
  Instant now{};
  engine.on_open(now);
  std::uint64_t sent = 0;
  std::uint64_t received = 0;
  for (auto _ : state) {
    engine.on_write(now += std::chrono::milliseconds(1), ByteView(pattern_at(sent), size));
    sent += size;
    received += engine.advance(now).deliver.size();
    if (const auto due = engine.next_deadline()) now = std::max(now, *due);
    received += engine.advance(now).deliver.size();
  }
  if (received != sent) state.SkipWithError("not every question was answered");
  state.SetItemsProcessed(state.iterations());
  set_bytes(state, size);
}
BENCHMARK(engine_exchange)->Arg(16)->Arg(4096);

// A streaming device's tape by the recorded clock.
void engine_stream(benchmark::State& state) {
  constexpr std::size_t kSize = 64;
  Exchanges schedule(kSize, false, true);
  Exchanges writes(kSize, true, false);
  ReplayConfig config;
  config.timing = Timing::recorded;
  config.strictness = 0;
  Engine engine(config, {.stamped_at_arrival = true}, schedule, writes);
  Instant now{};
  engine.on_open(now);
  std::uint64_t received = 0;
  for (auto _ : state) {
    if (const auto due = engine.next_deadline()) now = std::max(now, *due);
    received += engine.advance(now).deliver.size();
  }
  if (received == 0) state.SkipWithError("nothing was delivered");
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(engine_stream);

}  // namespace
}  // namespace porttape::bench
