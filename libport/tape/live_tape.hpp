#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <sys/types.h>

#include "libport/base/clock.hpp"
#include "libport/base/workers.hpp"
#include "libport/tape/disks.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// A tape in the making that holds up nobody: the caller's thread never waits for the disk, but for the one
// write that finds it slow. Owns the TapeWriter.
//
// Its phases, and who has the writer:
//
// | phase      | who writes | what comes        | next |
// |------------|------------|-------------------|------|
// | being made | a worker   | is queued         | direct, queued, not made |
// | direct     | the caller | is written        | queued: a write was slow, here or for a tape of that disk |
// | queued     | a worker   | is queued         | direct: the queue was used up, and no write was slow yet |
// | not made   | nobody     | is counted as lost| - |
// | finished   | nobody     | is counted as lost| - |
//
// finish() leads from each of the first three to `finished`, through the queue. While `direct`, SIGKILL costs
// at most the block that is being written. A flood that began while the files were made would keep the worker
// behind for ever: from kMostBehind on the caller takes the writer and empties the queue itself.
//
// The queue holds Options::queue_bytes. A full one holds the caller up while the disk works, half a second
// at most; what does not fit then is lost and told by a gap event like what the disk did not take. Written
// data is synced once a second. Without a thread to be had (limits) the caller writes.
//
// Drive it from one thread as a TapeWriter, finish() last. The destructor gives up what is not written yet.
class LiveTape {
 public:
  // A write that took so long means a slow disk, unless the thread was put aside for others meanwhile; one
  // that took kHungWrite always does.
  static constexpr std::chrono::milliseconds kLongWrite{3};
  static constexpr std::chrono::milliseconds kHungWrite{100};
  // So much may wait while the files are made; then the caller writes it, if the worker comes back in time.
  static constexpr std::size_t kMostBehind = std::size_t{256} << 10;

  struct Options {
    TapePaths paths;
    TapeHeader header;
    TapeWriterOptions writer = {};
    std::size_t queue_bytes = std::size_t{64} << 20;
    // status() has something new: a phase, slowness, a failure in the queue or of a sync. From any thread.
    std::function<void()> on_news = {};
    // What is known before the tape is: is written first, on a worker, once the tape is made. Owns what it
    // needs. Many blocks at once belong in a batch.
    std::function<void(TapeWriter&)> fill = {};
    // Makes the writer; TapeWriter::create unless a test wants another disk.
    std::function<Result<TapeWriter>(const Options&)> make = {};
    // By which it is measured how long the disk takes: this machine's unless a test wants another, which
    // outlives the workers.
    const Clock* disk_clock = nullptr;
  };

  struct Status {
    enum class Phase : std::uint8_t { being_made, direct, queued, not_made, finished };
    Phase phase = Phase::being_made;
    TapePaths paths;                  // as wanted; once made, its files
    std::string id;                   // of its header, once made
    std::optional<Error> error;       // not made, or finished and something is missing
    std::string failure;              // why the last block could not be written; empty when it was
    int sync_error = 0;               // the errno of the first sync that failed
    std::uint64_t bytes_written = 0;  // payload
    std::uint64_t bytes_lost = 0;     // also those that no gap tells of yet
    std::uint64_t bytes_waiting = 0;  // in the queue
    std::chrono::milliseconds slowest{0};
    // How long a worker has been waiting for the disk by now; nullopt if none is.
    std::optional<Nanos> silence;

    // Nothing more will be written.
    [[nodiscard]] bool over() const { return phase == Phase::not_made || phase == Phase::finished; }
  };

  // `workers` outlives the tape. Without `disks` it learns for itself alone.
  LiveTape(Workers& workers, std::shared_ptr<Disks> disks, Options options);
  ~LiveTape();
  LiveTape(const LiveTape&) = delete;
  LiveTape& operator=(const LiveTape&) = delete;

  void block(Direction direction, TapeTime at, ByteView data);
  // An event, or whatever else a TapeWriter is to be told, in its place among the blocks.
  using Note = std::function<void(TapeWriter&)>;
  void note(Note note);
  // As TapeWriter::lose().
  void lose(TapeTime at, std::uint64_t bytes, std::string why);
  // The last call: `end` event, sync, close, on a worker. Then on_news, and status() is `finished`.
  void finish(TapeTime at);

  [[nodiscard]] Status status() const;
  // Whether blocks wait for a worker just now, and do not go to the disk directly.
  [[nodiscard]] bool queued() const { return !direct_; }
  // Whether the caller's last block could not be written; what the queue could not write is news.
  [[nodiscard]] bool failing() const;

 private:
  struct Shared;
  struct Entry;
  bool direct();
  void leave_direct();
  [[nodiscard]] bool blocked(std::chrono::steady_clock::duration took);
  template <class Work>
  void write(const Work& work);
  void put(Entry entry);
  void call_worker(std::unique_lock<std::mutex>& lock);
  void help(std::unique_lock<std::mutex>& lock);
  bool make_room(std::unique_lock<std::mutex>& lock, std::size_t bytes);
  void sync_soon();

  Workers& workers_;
  std::shared_ptr<Disks> disks_;
  Workers::Strand strand_;
  Workers::Strand sync_strand_;
  std::shared_ptr<Shared> shared_;
  bool direct_ = false;  // the writer is this thread's
  long put_aside_ = 0;   // how often this thread was, when last looked at
  std::shared_ptr<const std::atomic<bool>> disk_is_slow_;
};

}  // namespace porttape
