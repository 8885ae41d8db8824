#include "libport/tape/live_tape.hpp"

#include <array>
#include <condition_variable>
#include <deque>
#include <exception>
#include <string>
#include <sys/resource.h>
#include <sys/stat.h>
#include <system_error>
#include <thread>
#include <utility>

#include "libport/base/clock.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// A disk that has not come back for so long hangs: a full queue holds up the caller no longer.
constexpr milliseconds kHung{500};
constexpr std::uint64_t kBatch = std::uint64_t{4} << 20;

constexpr std::string_view kQueueFull = "the disk did not keep up";

// Both at once on a slow disk, where each may take seconds.
void run_both(const std::function<void()>& one, const std::function<void()>& other) {
  std::thread beside;
  try {
    beside = std::thread(other);
  } catch (const std::system_error&) {
    other();
  }
  one();
  if (beside.joinable()) beside.join();
}

// All tapes sync at the same moments, so that a thread wakes once for all of them.
Instant next_sync() { return std::chrono::floor<seconds>(machine_clock().now()) + seconds(1); }

}  // namespace

// What waits in the queue.
struct LiveTape::Entry {
  Note work;
  TapeTime at{};
  std::size_t bytes = 0;
  bool last = false;       // finishes the tape
  std::uint64_t lost = 0;  // bytes that the writer is told to have been lost
};

// What the caller and a worker share. The writer is the worker's while `busy`, else the caller's.
struct LiveTape::Shared {
  struct Overflow {
    TapeTime at{};
    std::uint64_t bytes = 0;
  };

  Shared(Options given, std::shared_ptr<Disks> known)
      : options(std::move(given)),
        disk_clock(options.disk_clock != nullptr ? *options.disk_clock : machine_clock()),
        disks(std::move(known)) {
    status.paths = options.paths;
  }
  ~Shared() {
    abandon();
    disks->release(status.bytes_waiting);
  }
  Shared(const Shared&) = delete;
  Shared& operator=(const Shared&) = delete;

  void serve();
  void serve_queue();
  void give_up(const char* why);
  void make(std::unique_lock<std::mutex>& lock);
  void write_batch(std::unique_lock<std::mutex>& lock);
  void take_stock();
  std::uint64_t give_up_queue();
  void abandon();
  void sync();
  void tell() const {
    try {
      if (options.on_news) options.on_news();
    } catch (const std::exception&) {  // no memory: the caller sees it when it looks again
    }
  }

  const Options options;
  const Clock& disk_clock;
  const std::shared_ptr<Disks> disks;
  std::atomic<bool> sync_due = false;

  std::mutex mutex;  // guards the rest, but for the writer
  std::deque<Entry> queue;
  std::optional<Overflow> overflow;
  std::uint64_t untold = 0;  // bytes lost that the writer does not know of: of the queue and the overflow
  bool busy = false;
  bool wanted = false;  // the caller waits for the writer
  std::condition_variable handed_over;
  std::condition_variable room;
  bool slow = false;
  bool abandoned = false;
  milliseconds last_batch{0};
  std::optional<Instant> waits_since;  // a worker waits for the disk since then
  Status status;
  std::optional<dev_t> device;
  std::array<TapeSink::Sync, 3> syncers;

  std::optional<TapeWriter> writer;
};

void LiveTape::Shared::serve() {
  try {
    serve_queue();
  } catch (const std::exception& error) {  // no memory
    give_up(error.what());
  }
}

// Nothing more goes to this tape.
void LiveTape::Shared::give_up(const char* why) {
  std::unique_lock lock(mutex);
  const std::uint64_t bytes = give_up_queue();
  if (writer) {
    lock.unlock();  // this may write
    writer->lose({}, bytes, why);
    lock.lock();
  }
  status.phase = Status::Phase::not_made;
  status.error = make_error(Errc::io, std::string("the tape is given up: ") + why);
  waits_since.reset();
  busy = false;
  if (wanted) handed_over.notify_one();
  lock.unlock();
  tell();
}

void LiveTape::Shared::serve_queue() {
  std::unique_lock lock(mutex);
  const std::string failure = status.failure;
  if (status.phase == Status::Phase::being_made && !writer) make(lock);
  while (!queue.empty() && !abandoned && !wanted) write_batch(lock);
  const bool news = failure != status.failure || status.over() || status.phase == Status::Phase::being_made;
  if (status.phase == Status::Phase::being_made) status.phase = Status::Phase::queued;
  waits_since.reset();
  busy = false;
  if (wanted) handed_over.notify_one();
  lock.unlock();
  if (news) tell();
}

void LiveTape::Shared::make(std::unique_lock<std::mutex>& lock) {
  waits_since = disk_clock.now();
  lock.unlock();
  Result<TapeWriter> made = options.make ? options.make(options)
                                         : TapeWriter::create(options.paths, options.header, options.writer);
  if (made && options.fill) options.fill(*made);
  struct stat folder {};
  const bool known = made && ::stat(made->paths().read.c_str(), &folder) == 0;
  lock.lock();
  if (!made) {
    status.phase = Status::Phase::not_made;
    status.error = made.error();
    (void)give_up_queue();
    return;
  }
  writer = std::move(*made);
  syncers = writer->syncers();
  status.paths = writer->paths();
  status.id = writer->id();
  if (known) device = folder.st_dev;
  take_stock();
}

// With what the writer was to be told of, and a batch that has failed. How many bytes those are.
std::uint64_t LiveTape::Shared::give_up_queue() {
  const std::uint64_t bytes = status.bytes_waiting + std::exchange(untold, 0);
  status.bytes_lost += bytes;
  queue.clear();
  overflow.reset();
  disks->release(std::exchange(status.bytes_waiting, 0));
  return bytes;
}

// Nobody writes any more what is left: the tape says so.
void LiveTape::Shared::abandon() {
  if (!writer || (queue.empty() && !overflow)) return;
  std::uint64_t bytes = untold;
  for (const Entry& entry : queue) bytes += entry.bytes;
  const TapeTime at = queue.empty() ? overflow->at : queue.front().at;
  writer->lose(at, bytes, "the recorder was ended at once");
}

void LiveTape::Shared::write_batch(std::unique_lock<std::mutex>& lock) {
  std::deque<Entry> batch;
  std::uint64_t bytes = 0;
  std::uint64_t lost = 0;
  while (!queue.empty() && bytes < kBatch) {
    bytes += queue.front().bytes;
    lost += queue.front().lost;
    batch.push_back(std::move(queue.front()));
    queue.pop_front();
  }
  const Instant begin = disk_clock.now();
  waits_since = begin;
  const RunBoth beside = last_batch >= kHungWrite ? RunBoth(run_both) : RunBoth();
  lock.unlock();
  std::optional<Result<void>> finished;
  writer->begin_batch();
  for (const Entry& entry : batch) {
    if (entry.last) {
      finished = writer->finish(entry.at, beside);
    } else {
      entry.work(*writer);
    }
  }
  writer->commit(beside);
  const auto took = std::chrono::duration_cast<milliseconds>(disk_clock.now() - begin);
  lock.lock();
  status.slowest = std::max(status.slowest, took);
  last_batch = took;
  status.bytes_waiting -= bytes;
  untold -= lost;
  disks->release(bytes);
  room.notify_one();
  take_stock();
  if (!finished) return;
  status.phase = Status::Phase::finished;
  if (!*finished) status.error = finished->error();
}

void LiveTape::Shared::take_stock() {
  status.failure = writer->failure();
  status.bytes_written = writer->bytes_written();
  status.bytes_lost = writer->bytes_lost();
}

void LiveTape::Shared::sync() {
  sync_due = false;
  std::unique_lock lock(mutex);
  const std::array<TapeSink::Sync, 3> files = syncers;
  lock.unlock();
  int first_error = 0;
  for (const TapeSink::Sync& file : files) {
    const int error = file ? file() : 0;
    if (first_error == 0) first_error = error;
  }
  if (first_error == 0) return;
  lock.lock();
  const bool news = std::exchange(status.sync_error, first_error) == 0;
  lock.unlock();
  if (news) tell();
}

LiveTape::LiveTape(Workers& workers, std::shared_ptr<Disks> disks, Options options)
    : workers_(workers),
      disks_(disks ? std::move(disks) : std::make_shared<Disks>()),
      shared_(std::make_shared<Shared>(std::move(options), disks_)) {
  shared_->busy = true;
  if (!workers_.post(strand_, [shared = shared_] { shared->serve(); })) shared_->serve();
}

// The writer closes its files when it goes, which may wait: not here if a worker can do it.
LiveTape::~LiveTape() {
  {
    const std::lock_guard lock(shared_->mutex);
    shared_->abandoned = true;
  }
  try {
    (void)workers_.post(strand_, [shared = std::move(shared_)] {});
  } catch (const std::exception&) {  // no memory: here, then
  }
}

void LiveTape::block(Direction direction, TapeTime at, ByteView data) {
  if (data.empty()) return;
  const auto write_to = [direction, at](TapeWriter& writer, ByteView bytes) {
    writer.block(direction, at, bytes);
  };
  if (direct()) {
    write([&](TapeWriter& writer) { write_to(writer, data); });
  } else {
    put({[write_to, bytes = Bytes(data.begin(), data.end())](TapeWriter& writer) { write_to(writer, bytes); },
         at, data.size()});
  }
}

void LiveTape::note(Note note) {
  if (direct()) {
    write(note);
  } else {
    put({std::move(note)});
  }
}

void LiveTape::lose(TapeTime at, std::uint64_t bytes, std::string why) {
  const auto tell = [at, bytes, why = std::move(why)](TapeWriter& writer) { writer.lose(at, bytes, why); };
  if (direct()) {
    write(tell);
  } else {
    put({.work = tell, .at = at, .lost = bytes});
  }
}

void LiveTape::finish(TapeTime at) {
  leave_direct();
  put({.work = {}, .at = at, .last = true});
}

// Whether the writer is this thread's.
bool LiveTape::direct() {
  if (direct_ && disk_is_slow_ && *disk_is_slow_) leave_direct();
  if (direct_) return true;
  const std::lock_guard lock(shared_->mutex);
  if (!disk_is_slow_ && shared_->device) {
    disk_is_slow_ = disks_->slow(*shared_->device);
    sync_strand_ = disks_->sync_strand(*shared_->device);
  }
  const bool owes = !shared_->queue.empty() || shared_->overflow;
  if (shared_->busy || shared_->slow || owes || !shared_->writer || shared_->status.over()) return false;
  if (disk_is_slow_ && *disk_is_slow_) {
    shared_->slow = true;
    return false;
  }
  shared_->status.phase = Status::Phase::direct;
  direct_ = true;
  return true;
}

void LiveTape::leave_direct() {
  if (!std::exchange(direct_, false)) return;
  const std::lock_guard lock(shared_->mutex);
  shared_->slow = true;
  shared_->status.phase = Status::Phase::queued;
  shared_->take_stock();
}

// A processor that others want looks like a slow disk: the kernel counts how often a thread was put aside.
bool LiveTape::blocked(Nanos took) {
  rusage usage{};
  if (::getrusage(RUSAGE_THREAD, &usage) != 0) return true;
  const bool others = std::exchange(put_aside_, usage.ru_nivcsw) != usage.ru_nivcsw;
  return took >= kHungWrite || !others;
}

template <class Work>
void LiveTape::write(const Work& work) {
  const Clock& clock = shared_->disk_clock;
  const Instant begin = clock.now();
  work(*shared_->writer);
  const Nanos took = clock.now() - begin;
  sync_soon();
  if (took < kLongWrite || !blocked(took)) return;
  leave_direct();
  {
    const std::lock_guard lock(shared_->mutex);
    shared_->status.slowest = std::chrono::duration_cast<milliseconds>(took);
    if (shared_->device) disks_->note_slow(*shared_->device);
  }
  shared_->tell();
}

void LiveTape::put(Entry entry) {
  std::unique_lock lock(shared_->mutex);
  Status& status = shared_->status;
  if (status.over()) {
    status.bytes_lost += entry.bytes + entry.lost;
    return;
  }
  if (entry.bytes > 0 && !make_room(lock, entry.bytes)) {
    if (!shared_->overflow) shared_->overflow = Shared::Overflow{entry.at, 0};
    shared_->overflow->bytes += entry.bytes;
    shared_->untold += entry.bytes;
    return;
  }
  if (const auto lost = std::exchange(shared_->overflow, std::nullopt)) {
    shared_->queue.push_back(
        {.work = [lost](TapeWriter& writer) { writer.lose(lost->at, lost->bytes, kQueueFull); },
         .at = lost->at,
         .lost = lost->bytes});
  }
  const bool last = entry.last;
  status.bytes_waiting += entry.bytes;
  shared_->untold += entry.lost;
  shared_->queue.push_back(std::move(entry));
  if (status.bytes_waiting > kMostBehind && !last) help(lock);
  call_worker(lock);
  sync_soon();
}

// Whether so much goes into the queue. A flood is held up to the pace of a disk that works; one that hangs
// holds up nobody.
bool LiveTape::make_room(std::unique_lock<std::mutex>& lock, std::size_t bytes) {
  const Status& status = shared_->status;
  const auto fits = [&] {
    return status.bytes_waiting + bytes <= shared_->options.queue_bytes && disks_->reserve(bytes);
  };
  if (fits()) return true;
  if (!shared_->waits_since) return false;
  const Nanos hangs_in = *shared_->waits_since + kHung - shared_->disk_clock.now();
  return shared_->room.wait_for(lock, hangs_in, fits);
}

// A flood that began while the files were made would never let the worker catch up.
void LiveTape::help(std::unique_lock<std::mutex>& lock) {
  Shared& shared = *shared_;
  if (shared.slow || !shared.writer || shared.status.over()) return;
  shared.wanted = true;
  const bool free = shared.handed_over.wait_for(lock, kHungWrite, [&shared] { return !shared.busy; });
  shared.wanted = false;
  if (!free) {
    shared.slow = true;
    return;
  }
  shared.busy = true;
  while (!shared.queue.empty()) shared.write_batch(lock);
  shared.waits_since.reset();
  shared.busy = false;
}

// A worker serves the queue until it is empty. Releases the lock.
void LiveTape::call_worker(std::unique_lock<std::mutex>& lock) {
  if (shared_->queue.empty() || std::exchange(shared_->busy, true)) return lock.unlock();
  lock.unlock();
  if (!workers_.post(strand_, [shared = shared_] { shared->serve(); })) shared_->serve();
}

void LiveTape::sync_soon() {
  if (!shared_->options.writer.sync || shared_->sync_due.exchange(true)) return;
  // Without a thread the tape is synced at its end.
  (void)workers_.post_at(next_sync(), sync_strand_, [shared = shared_] { shared->sync(); });
}

LiveTape::Status LiveTape::status() const {
  const std::lock_guard lock(shared_->mutex);
  if (direct_) shared_->take_stock();
  Status status = shared_->status;
  status.bytes_lost += shared_->untold;
  if (shared_->waits_since) status.silence = shared_->disk_clock.now() - *shared_->waits_since;
  return status;
}

bool LiveTape::failing() const { return direct_ && shared_->writer->failing(); }

}  // namespace porttape
