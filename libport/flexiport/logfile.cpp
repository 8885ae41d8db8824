#include <algorithm>
#include <chrono>
#include <cstring>
#include <flexiport/logfile.h>
#include <optional>
#include <thread>
#include <utility>

#include "libport/base/clock.hpp"
#include "libport/base/time.hpp"
#include "libport/flexiport/backing.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_writer.hpp"

namespace flexiport {
namespace {

using porttape::Bytes;
using porttape::ByteView;
using porttape::Instant;
using porttape::TapeReader;
using porttape::TapeTime;
using porttape::TapeWriter;

template <class T>
T value_of(porttape::Result<T> result) {
  if (!result) raise(result.error());
  return std::move(*result);
}

// One direction of a tape that is read: its bytes in order, each with a time.
class Stream {
 public:
  explicit Stream(TapeReader reader) : reader_(std::move(reader)) { load(); }

  // Bytes of the block at the front; empty at the end.
  [[nodiscard]] ByteView front() const { return ByteView(block_).subspan(used_); }
  [[nodiscard]] TapeTime at() const { return at_; }
  [[nodiscard]] bool at_end() const { return front().empty(); }

  void consume(std::size_t count) {
    used_ += count;
    if (at_end()) load();
  }

 private:
  void load() {
    block_.clear();
    used_ = 0;
    while (block_.empty()) {
      const auto record = value_of(reader_.next());
      if (!record) return;
      block_.assign(record->data.begin(), record->data.end());
      at_ = record->at;
    }
  }

  TapeReader reader_;
  Bytes block_;
  std::size_t used_ = 0;
  TapeTime at_{};
};

}  // namespace

// A tape that is open: two streams to read, or a writer.
struct Tape {
  std::string name;
  bool ignore_times = false;
  Instant zero{};
  std::optional<Stream> reads;
  std::optional<Stream> writes;
  std::optional<TapeWriter> writer;
  Bytes due;  // come, and not read yet

  void start(bool read) {
    const porttape::TapePaths paths = porttape::literal_tape(name);
    due.clear();
    if (read) {
      reads.emplace(value_of(TapeReader::open(paths, TapeReader::Select::reads_only)));
      writes.emplace(value_of(TapeReader::open(paths, TapeReader::Select::writes_only)));
      zero = porttape::machine_clock().now();
    } else {
      writer.reset();
      zero = porttape::machine_clock().now();
      const porttape::TapeHeader header{.device = name,
                                        .driver = "in-process",
                                        .zero = porttape::tape_zero(zero, porttape::machine_clock()),
                                        .stamped = porttape::Stamped::read};
      writer.emplace(
          value_of(TapeWriter::create(paths, header, {.on_existing = porttape::OnExisting::overwrite})));
    }
  }

  [[nodiscard]] Instant when(TapeTime at) const { return ignore_times ? zero : zero + at.time_since_epoch(); }
  [[nodiscard]] TapeTime now() const {
    return TapeTime{std::chrono::duration_cast<porttape::Micros>(porttape::machine_clock().now() - zero)};
  }

  void collect(std::size_t most) {
    while (due.size() < most && !reads->at_end() && when(reads->at()) <= porttape::machine_clock().now()) {
      const ByteView block = reads->front();
      due.insert(due.end(), block.begin(), block.end());
      reads->consume(block.size());
    }
  }

  // False when the timeout passed first.
  bool wait(std::size_t most, const Timeout& timeout) {
    collect(most);
    if (!due.empty() || reads->at_end()) return true;
    const Instant next = when(reads->at());
    const Instant limit = timeout._sec < 0 ? next : porttape::machine_clock().now() + to_micros(timeout);
    std::this_thread::sleep_until(std::min(next, limit));
    collect(most);
    return !due.empty();
  }
};

LogFile::LogFile(unsigned int debug) : _tape(NULL), _debug(debug) {}
LogFile::~LogFile() { Close(); }

void LogFile::Open(const std::string& fileName, bool read, bool ignoreTimes) {
  if (_tape != NULL) throw PortException("Log file is already open.");
  auto tape = std::make_unique<Tape>();
  tape->name = fileName;
  tape->ignore_times = ignoreTimes;
  tape->start(read);
  _tape = tape.release();
}

void LogFile::Close() {
  delete _tape;
  _tape = NULL;
}

bool LogFile::IsOpen() const { return _tape != NULL; }

namespace {

Tape& to_read(Tape* tape) {
  if (tape == NULL) throw PortException("Log file is not open.");
  if (!tape->reads) throw PortException("Log file is open for writing.");
  return *tape;
}

TapeWriter& to_write(Tape* tape) {
  if (tape == NULL) throw PortException("Log file is not open.");
  if (!tape->writer) throw PortException("Log file is open for reading.");
  return *tape->writer;
}

// After each block: a full disk must not go unseen.
void check(const TapeWriter& writer) {
  if (writer.failing()) throw PortException("Log file cannot be written: " + writer.failure());
}

}  // namespace

void LogFile::ResetFile() {
  if (_tape == NULL) throw PortException("Log file is not open.");
  _tape->start(_tape->reads.has_value());
}

ssize_t LogFile::Read(void* data, size_t count, Timeout& timeout) {
  Tape& tape = to_read(_tape);
  if (count == 0) return 0;
  if (!tape.wait(count, timeout)) return -1;
  const std::size_t size = std::min(count, tape.due.size());
  std::memcpy(data, tape.due.data(), size);
  tape.due.erase(tape.due.begin(), tape.due.begin() + static_cast<std::ptrdiff_t>(size));
  return static_cast<ssize_t>(size);
}

ssize_t LogFile::BytesAvailable(const Timeout& timeout) {
  Tape& tape = to_read(_tape);
  constexpr std::size_t kMost = std::size_t{64} * 1024;
  tape.wait(kMost, timeout);
  return static_cast<ssize_t>(tape.due.size());
}

bool LogFile::CheckWrite(const void* const data, const size_t count, size_t* const written,
                         const Timeout* const timeout) {
  Stream& expected = *to_read(_tape).writes;
  ByteView rest(static_cast<const porttape::Byte*>(data), count);
  bool right = true;
  while (right && !rest.empty()) {
    const ByteView block = expected.front();
    const std::size_t size = std::min(block.size(), rest.size());
    const bool early = timeout != NULL && timeout->_sec >= 0 &&
                       porttape::machine_clock().now() + to_micros(*timeout) < _tape->when(expected.at());
    const auto same =
        std::mismatch(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(size), block.begin());
    const auto matching = early ? 0 : static_cast<std::size_t>(same.first - rest.begin());
    right = size > 0 && matching == size;
    rest = rest.subspan(matching);
    if (matching > 0) expected.consume(matching);
  }
  if (written != NULL) *written = count - rest.size();
  return right;
}

void LogFile::Flush() {}
void LogFile::Drain() {}

void LogFile::WriteRead(const void* const data, size_t count) {
  TapeWriter& writer = to_write(_tape);
  writer.read_block(_tape->now(), {static_cast<const porttape::Byte*>(data), count});
  check(writer);
}

void LogFile::WriteWrite(const void* const data, size_t count) {
  TapeWriter& writer = to_write(_tape);
  writer.write_block(_tape->now(), {static_cast<const porttape::Byte*>(data), count});
  check(writer);
}

}  // namespace flexiport
