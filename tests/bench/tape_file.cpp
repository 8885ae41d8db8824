#include "tests/bench/tape_file.hpp"

#include <algorithm>
#include <array>
#include <fcntl.h>
#include <random>
#include <utility>

#include "tests/bench/commands.hpp"
#include "tests/bench/line.hpp"
#include "tests/bench/pattern.hpp"

namespace porttape::bench {
namespace po = boost::program_options;
namespace {

constexpr std::size_t kHeader = 12;
constexpr std::int64_t kMicrosASecond = 1'000'000;

void put_u32(Byte* out, std::uint32_t value) {
  for (int i = 0; i < 4; ++i) out[i] = static_cast<Byte>(value >> (24 - 8 * i));
}

std::uint32_t get_u32(const Byte* in) {
  return (std::uint32_t{in[0]} << 24) | (std::uint32_t{in[1]} << 16) | (std::uint32_t{in[2]} << 8) | in[3];
}

}  // namespace

BlockFile::BlockFile(const std::string& path, Mode mode)
    : path_(path), file_(std::fopen(path.c_str(), mode == Mode::read ? "rbe" : "wbe")), buffer_(1 << 18) {
  if (file_ == nullptr) throw_errno(path);
  std::setvbuf(file_, reinterpret_cast<char*>(buffer_.data()), _IOFBF, buffer_.size());
}

BlockFile::~BlockFile() {
  if (file_ != nullptr) std::fclose(file_);
}

void BlockFile::put(std::int64_t time_us, const Byte* data, std::size_t size) {
  Byte header[kHeader];
  put_u32(header, static_cast<std::uint32_t>(time_us / kMicrosASecond));
  put_u32(header + 4, static_cast<std::uint32_t>(time_us % kMicrosASecond));
  put_u32(header + 8, static_cast<std::uint32_t>(size));
  if (std::fwrite(header, 1, kHeader, file_) != kHeader || std::fwrite(data, 1, size, file_) != size) {
    throw_errno(path_);
  }
}

void BlockFile::finish() {
  if (std::fclose(std::exchange(file_, nullptr)) != 0) throw_errno(path_);
}

bool BlockFile::get(Block& block) {
  Byte header[kHeader];
  const std::size_t n = std::fread(header, 1, kHeader, file_);
  if (n == 0 && std::feof(file_) != 0) return false;
  if (n != kHeader) throw BenchError(path_ + ": torn block header");
  block.time_us = std::int64_t{get_u32(header)} * kMicrosASecond + get_u32(header + 4);
  const std::uint32_t size = get_u32(header + 8);
  if (size > (1U << 24)) throw BenchError(path_ + ": a block of " + std::to_string(size) + " bytes");
  block.data.resize(size);
  if (std::fread(block.data.data(), 1, size, file_) != size) throw BenchError(path_ + ": torn block");
  return true;
}

std::vector<Arrival> arrivals_of(const std::string& tape) {
  BlockFile file(tape + "r", BlockFile::Mode::read);
  std::vector<Arrival> arrivals;
  std::uint64_t end = 0;
  for (BlockFile::Block block; file.get(block);) {
    end += block.data.size();
    arrivals.push_back({block.time_us, end});
  }
  return arrivals;
}

void check_pattern_file(const std::string& path, std::uint64_t skip, std::uint64_t size) {
  BlockFile file(path, BlockFile::Mode::read);
  std::uint64_t offset = 0;
  std::int64_t last = 0;
  for (BlockFile::Block block; file.get(block);) {
    if (block.time_us < last) throw BenchError(path + ": time goes back at byte " + std::to_string(offset));
    last = block.time_us;
    for (std::size_t at = 0; at < block.data.size();) {
      const std::uint64_t here = offset + at;
      const std::size_t left = block.data.size() - at;
      const bool skipping = here < skip;
      const std::size_t piece = std::min(left, skipping ? static_cast<std::size_t>(skip - here) : kWindow);
      if (!skipping && !is_pattern(here - skip, block.data.data() + at, piece)) {
        throw BenchError(path + ": wrong bytes at " + std::to_string(here));
      }
      at += piece;
    }
    offset += block.data.size();
  }
  if (offset != size) {
    throw BenchError(path + ": " + std::to_string(offset) + " bytes, expected " + std::to_string(size));
  }
}

int make_tape_command(const Arguments& arguments) {
  CommandLine line(
      "Writes a tape of the test pattern: NAMEr, with --both NAMEw too, and NAMEe with a header line.\n"
      "Usage: linebench make-tape --tape NAME [options]\n"
      "  linebench make-tape --tape steps.log --blocks 2000 --block 16 --gap-min 200 --gap-max 5000\n");
  line.option()("tape", po::value<std::string>()->required(), "its name, as in laser.log")(
      "block", po::value<std::size_t>()->default_value(64), "bytes a block, at most 65536")(
      "blocks", po::value<std::uint64_t>()->default_value(0), "how many; or")(
      "bytes", po::value<std::uint64_t>()->default_value(0), "payload in all")(
      "gap-min", po::value<std::int64_t>()->default_value(10), "µs between blocks")(
      "gap-max", po::value<std::int64_t>()->default_value(10), "µs between blocks")(
      "seed", po::value<unsigned>()->default_value(1), "of the gaps")("both", po::bool_switch(),
                                                                      "every second block goes to NAMEw");
  if (!line.parse(arguments)) return 0;
  const auto block = std::clamp<std::size_t>(line.get<std::size_t>("block"), 1, kWindow);
  const auto bytes = line.get<std::uint64_t>("bytes");
  const std::uint64_t blocks = bytes > 0 ? (bytes + block - 1) / block : line.get<std::uint64_t>("blocks");
  if (blocks == 0) throw UsageError("give --blocks or --bytes");
  const auto name = line.get<std::string>("tape");

  std::mt19937 random(line.get<unsigned>("seed"));
  std::uniform_int_distribution<std::int64_t> gap(line.get<std::int64_t>("gap-min"),
                                                  line.get<std::int64_t>("gap-max"));
  BlockFile read(name + "r", BlockFile::Mode::write);
  BlockFile write(name + "w", BlockFile::Mode::write);
  std::array<std::uint64_t, 2> offset{};
  std::int64_t time = 0;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    const std::size_t side = line.get<bool>("both") ? i % 2 : 0;
    time += gap(random);
    (side == 0 ? read : write).put(time, pattern_at(offset[side]), block);
    offset[side] += block;
    if (i % 65536 == 0) check_signals();
  }
  read.finish();
  write.finish();
  std::FILE* events = std::fopen((name + "e").c_str(), "we");
  if (events == nullptr) throw_errno(name + "e");
  std::fputs(
      "{\"format\":\"porttape-events\",\"version\":1,\"created\":\"2024-01-01T00:00:00Z\",\"device\":"
      "\"linebench\"}\n",
      events);
  if (std::fclose(events) != 0) throw_errno(name + "e");
  return 0;
}

int read_command(const Arguments& arguments) {
  CommandLine line(
      "Reads files whole, as fast as the system gives them: the floor of every reader.\n"
      "Usage: linebench read FILE...\n",
      "file");
  line.option()("file", po::value<Arguments>()->required(), "what to read");
  if (!line.parse(arguments)) return 0;
  Bytes buffer(1 << 18);
  std::uint64_t bytes = 0;
  const std::int64_t start = now_ns();
  for (const std::string& path : line.list("file")) {
    const UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (!file) throw_errno(path);
    for (std::size_t n; (n = read_some(file.get(), buffer.data(), buffer.size())) > 0;) bytes += n;
  }
  const double seconds = static_cast<double>(now_ns() - start) / 1e9;
  JsonLine()
      .add("bytes", bytes)
      .add("seconds", seconds)
      .add("GBps", static_cast<double>(bytes) / 1e9 / seconds)
      .print();
  return 0;
}

}  // namespace porttape::bench
