#include "libport/supervise/tap_transfers.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <fmt/format.h>
#include <optional>
#include <poll.h>
#include <span>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <termios.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/supervise/cooked_line.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

constexpr Nanos kShortOf = milliseconds(1);  // between looks at a read that lacks bytes
constexpr Nanos kTenth = milliseconds(100);  // the unit of VTIME
constexpr std::size_t kMostAtOnce = std::size_t{64} * 1024;
constexpr std::size_t kMostParts = 1024;        // UIO_MAXIOV
constexpr std::size_t kMostOfAll = 0x7ffff000;  // in one call: MAX_RW_COUNT of the kernel
constexpr std::size_t kPiece = 2048;            // that the kernel takes of a program's bytes at once

// Where the program's bytes are, or the kernel's error.
struct Where {
  std::vector<iovec> parts = {};
  int error = 0;
};

bool is_negative(std::uint64_t size) { return static_cast<std::int64_t>(size) < 0; }

Where where_of(const Call& call, bool several) {
  const std::uint64_t size = call.argument(2);
  if (!several) {
    if (is_negative(size)) return {.error = EFAULT};
    // NOLINTNEXTLINE(performance-no-int-to-ptr): an address in another process
    return {.parts = {iovec{reinterpret_cast<void*>(call.argument(1)), size}}};
  }
  if (size > kMostParts) return {.error = EINVAL};
  Where where{.parts = std::vector<iovec>(size)};
  if (!call.read(call.argument(1), std::as_writable_bytes(std::span(where.parts)))) return {.error = EFAULT};
  if (std::ranges::any_of(where.parts, [](const iovec& part) { return is_negative(part.iov_len); }))
    return {.error = EINVAL};
  return where;
}

std::size_t size_of(const std::vector<iovec>& parts) {
  std::size_t size = 0;
  for (const iovec& part : parts) size += std::min(part.iov_len, kMostOfAll - size);
  return size;
}

// Of those behind the first `skipped` bytes.
template <class Each>
bool for_each_part(const std::vector<iovec>& parts, std::size_t skipped, Bytes& bytes, const Each& each) {
  std::size_t at = 0;
  for (const iovec& part : parts) {
    const std::size_t past = std::min(part.iov_len, skipped);
    skipped -= past;
    const std::size_t size = std::min(part.iov_len - past, bytes.size() - at);
    if (size > 0 &&
        !each(reinterpret_cast<std::uint64_t>(part.iov_base) + past, std::span(bytes).subspan(at, size)))
      return false;
    at += size;
  }
  return true;
}

bool hung_up(int fd) {
  pollfd ready{fd, POLLIN, 0};
  return ::poll(&ready, 1, 0) > 0 && (ready.revents & (POLLHUP | POLLERR)) != 0;
}

bool is_loss(int error) { return error == EIO || error == ENODEV || error == ENXIO; }

}  // namespace

// A read or write that is being done.
struct TapTransfers::Transfer {
  Transfer(const Call& of, bool is_write, std::vector<iovec> where, std::shared_ptr<TappedFile> duplicate)
      : call(of), writes(is_write), parts(std::move(where)), file(std::move(duplicate)) {}

  Call call;
  bool writes;
  std::vector<iovec> parts;
  std::shared_ptr<TappedFile> file;
  Bytes bytes = {};         // to write: some of them,
  std::size_t begin = 0;    // from here
  std::size_t done = 0;     // are written
  std::size_t size = 0;     // to be written, or that may be read
  bool breaks_off = false;  // a signal has come: what is there is all that is read

  // Of a tty that gives bytes, not lines; nothing where it is another, or not known.
  struct Needs {
    std::size_t least = 0;  // VMIN
    Nanos patience = {};    // VTIME
  };
  std::optional<Needs> needs = {};
  bool looked = false;  // at what it needs: at its begin, as the kernel does

  // The next to write. False: they are not to be had.
  bool load() {
    if (!call.waits()) return false;
    for (const std::size_t most : {kMostAtOnce, kPiece}) {
      begin = done;
      bytes.resize(std::min(most, size - done));
      const bool all = for_each_part(parts, begin, bytes, [&](std::uint64_t address, auto part) {
        return call.read(address, std::as_writable_bytes(part));
      });
      if (all) return true;
    }
    bytes.clear();
    return false;
  }
  Instant began = {};
  std::optional<Instant> last_byte = {};
  std::size_t seen = 0;
  std::weak_ptr<KeptCall> kept = {};  // whose owner has this
};

TapTransfers::TapTransfers(Loop& loop, TappedLine& line, TappedFiles& files, Calls calls)
    : loop_(&loop),
      line_(&line),
      files_(&files),
      ready_(std::make_shared<UniqueFd>(::epoll_create1(EPOLL_CLOEXEC))),
      calls_(std::move(calls)) {
  if (!*ready_) return;
  ready_watch_.emplace(loop, ready_->get(), [this] { on_ready(); });
  ready_watch_->watch_readable(true);
}

CallPart::Decision TapTransfers::decide(Supervisor& supervisor, const Call& call,
                                        std::shared_ptr<TappedFile> file) {
  const bool several = call.number() != SYS_read && call.number() != SYS_write;
  const bool writes =
      call.number() == SYS_write || call.number() == SYS_writev || call.number() == SYS_pwritev2;
  Where where = where_of(call, several);
  if (where.error != 0) return outcome::Refuse{where.error};
  const auto transfer = std::make_shared<Transfer>(call, writes, std::move(where.parts), std::move(file));
  transfer->began = loop_->now();
  transfer->size = size_of(transfer->parts);
  if (writes && !writers_.empty() && transfer->size > 0) {
    if (!transfer->file->waits()) return outcome::Refuse{EAGAIN};
    keep(supervisor, transfer);
    return CallPart::Kept{};
  }
  if (std::optional<Outcome> done = writes ? write_now(*transfer) : read_now(*transfer))
    return std::move(*done);
  keep(supervisor, transfer);
  wait(transfer->kept.lock(), transfer);
  return CallPart::Kept{};
}

void TapTransfers::keep(Supervisor& supervisor, const std::shared_ptr<Transfer>& transfer) {
  const std::shared_ptr<KeptCall> kept = supervisor.keep(transfer->call);
  transfer->kept = kept;
  kept_.push_back(transfer);
  if (transfer->writes) writers_.push_back(transfer);
  kept->on_gone([this, weak = std::weak_ptr(transfer)] {
    const auto waiting = weak.lock();
    if (!waiting) return;
    const std::shared_ptr<TappedFile> file = waiting->file;
    break_off(*waiting);
    end(*waiting);
    if (file) (void)read_on(file);
  });
}

// By a signal: what has been done of it is its result.
void TapTransfers::break_off(Transfer& transfer) {
  const auto waiting = transfer.kept.lock();
  if (!waiting || waiting->over()) return;
  if (transfer.writes) {
    if (transfer.done == 0) return;
    let_go(transfer);
    return waiting->finish(outcome::Answer{static_cast<std::int64_t>(transfer.done)});
  }
  transfer.breaks_off = true;
  std::optional<Outcome> done = read_now(transfer);
  const auto* const some = done ? std::get_if<outcome::Answer>(&*done) : nullptr;
  if (some == nullptr || some->value <= 0) return;
  let_go(transfer);
  waiting->finish(std::move(*done));
}

// Nothing: it is to be tried again.
std::optional<Outcome> TapTransfers::write_now(Transfer& transfer) {
  const WithoutWaiting now(*transfer.file);
  const bool waits = now.program_waits();
  while (true) {
    if (transfer.done == transfer.begin + transfer.bytes.size() && transfer.done < transfer.size &&
        !transfer.load()) {
      if (transfer.done > 0) return outcome::Answer{static_cast<std::int64_t>(transfer.done)};
      return outcome::Refuse{EFAULT};
    }
    const ByteView left = ByteView(transfer.bytes).subspan(transfer.done - transfer.begin);
    const ssize_t size = ::write(transfer.file->fd(), left.data(), left.size());
    if (size < 0 && errno == EINTR) continue;
    if (size >= 0) {
      if (size > 0) wrote(transfer.file->fd(), left.first(static_cast<std::size_t>(size)));
      transfer.done += static_cast<std::size_t>(size);
      const bool all = transfer.done == transfer.size;
      const bool full = static_cast<std::size_t>(size) < left.size();
      if (all || (full && !waits)) return outcome::Answer{static_cast<std::int64_t>(transfer.done)};
      if (size > 0) continue;
      return std::nullopt;
    }
    const int error = errno;
    if (error == EAGAIN && waits) return std::nullopt;
    if (is_loss(error)) line_->lost(errno_text(error));
    if (transfer.done > 0) return outcome::Answer{static_cast<std::int64_t>(transfer.done)};
    return outcome::Refuse{error};
  }
}

// How much a read that waits takes now, 0 where its time is over; nothing: it waits on. As n_tty_read() of
// the kernel has it: termios(3), "Canonical and noncanonical mode".
std::optional<std::size_t> TapTransfers::readable_now(Transfer& transfer) const {
  const int fd = transfer.file->fd();
  termios made{};
  if (!std::exchange(transfer.looked, true) && ::tcgetattr(fd, &made) == 0 && (made.c_lflag & ICANON) == 0)
    transfer.needs = {.least = made.c_cc[VMIN], .patience = kTenth * made.c_cc[VTIME]};
  if (!transfer.needs || transfer.size == 0) return transfer.size;
  const auto [least, patience] = *transfer.needs;
  int there = 0;
  // What a read does without waiting, too, but for EAGAIN. It waits for a kernel's thread that is just
  // bringing bytes, and longer than these take; where they are told of, whether there are any is asked.
  if (patience == Nanos(0) && least <= 1) {
    const bool asks = transfer.kept.expired() && transfer.file->watch().armed;
    return asks && ::ioctl(fd, FIONREAD, &there) == 0 && there == 0 ? std::nullopt
                                                                    : std::optional(transfer.size);
  }
  if (hung_up(fd) || ::ioctl(fd, FIONREAD, &there) != 0) return transfer.size;
  const auto available = static_cast<std::size_t>(std::max(there, 0));
  const bool any = least == 0;
  const std::size_t needed = any ? 1 : std::min(least, transfer.size);
  const Instant now = loop_->now();
  if (available > transfer.seen) transfer.last_byte = now;
  transfer.seen = available;
  const Instant since = any ? transfer.began : transfer.last_byte.value_or(now);
  const bool over = patience > Nanos(0) && (any || available > 0) && now >= since + patience;
  if (available < needed && !over) return std::nullopt;
  return std::min(transfer.size, available);
}

std::optional<Outcome> TapTransfers::read_now(Transfer& transfer) {
  // What is read for a thread that has ended would be lost; its call is dropped soon.
  if (!transfer.kept.expired() && !transfer.call.waits()) return std::nullopt;
  const int fd = transfer.file->fd();
  const WithoutWaiting no_wait(*transfer.file);
  const bool waits = no_wait.program_waits();
  const std::optional<std::size_t> most =
      waits && !transfer.breaks_off ? readable_now(transfer) : transfer.size;
  if (!most) return std::nullopt;
  if (*most == 0) return outcome::Answer{0};
  Bytes bytes(std::min(*most, kMostAtOnce));
  ssize_t size = 0;
  do {
    size = ::read(fd, bytes.data(), bytes.size());
  } while (size < 0 && errno == EINTR);
  const int error = errno;
  if (size < 0 && error == EAGAIN && waits) {
    // Of bytes that are there nobody tells again. The kernel keeps them for a reader that is not seen, which
    // has the line to itself until its own read ends.
    int there = 0;
    transfer.seen = ::ioctl(fd, FIONREAD, &there) == 0 && there > 0 ? static_cast<std::size_t>(there) : 0;
    if (transfer.needs && transfer.needs->least == 0) return outcome::Answer{0};
    return std::nullopt;
  }
  if (size < 0) {
    if (is_loss(error)) line_->lost(errno_text(error));
    return outcome::Refuse{error};
  }
  bytes.resize(static_cast<std::size_t>(size));
  if (size > 0) got(fd, bytes);
  if (size == 0 && hung_up(fd)) line_->lost("the line hung up");
  const bool all = for_each_part(transfer.parts, 0, bytes, [&](std::uint64_t address, auto part) {
    return transfer.call.write(address, std::as_bytes(part));
  });
  if (!all) return outcome::Refuse{EFAULT};
  return outcome::Answer{size};
}

void TapTransfers::wait(const std::shared_ptr<KeptCall>& kept, const std::shared_ptr<Transfer>& transfer) {
  const auto again = [this, weak = std::weak_ptr(transfer)] {
    const auto waiting = weak.lock();
    if (!waiting) return;
    const std::shared_ptr<TappedFile> file = waiting->file;
    go_on(waiting);
    if (file && !waiting->file) (void)read_on(file);
  };
  // Bytes that are there and not enough, or not ours, would be told again and again, or never.
  if (transfer->seen > 0) return kept->call_after(kShortOf, again);
  if (const auto& needs = transfer->needs) {
    if (needs->least == 0) {
      kept->call_at(transfer->began + needs->patience, again);
    } else if (needs->patience == Nanos(0) && needs->least > transfer->size) {
      return kept->call_after(kShortOf, again);  // poll() waits for VMIN bytes
    }
  }
  if (!watch(*transfer)) return kept->call_after(kShortOf, again);
}

void TapTransfers::wrote(int fd, ByteView data) {
  termios line{};
  if (::tcgetattr(fd, &line) == 0)
    tell_line_changes(changed_when_written(line, data), "sends other bytes than it was given");
  line_->wrote(data);
}

void TapTransfers::got(int fd, ByteView data) {
  termios line{};
  if (::tcgetattr(fd, &line) == 0)
    tell_line_changes(sent_back_when_read(line, data), "sends back what comes to it");
  line_->got(data);
}

void TapTransfers::tell_line_changes(std::string_view setting, std::string_view what) {
  if (setting.empty()) return;
  calls_.tell(fmt::format(
      "{}: with the setting '{}' the device's line {}; the tape has what the command wrote and read, and a "
      "replay of it may differ there (porttape record without --tap has what the line sent)",
      line_->device_name(), setting, what));
}

// Once, as long as it tells of what is waited for. False: that is not to be had.
bool TapTransfers::watch(Transfer& transfer) {
  if (!ready_watch_) return false;
  TappedFile::Watch& of_file = transfer.file->watch();
  if (of_file.armed && !transfer.writes) return true;
  if (of_file.number == 0) {
    std::erase_if(watched_, [](const auto& each) { return each.second.expired(); });
    of_file.number = ++number_;
    watched_.emplace(of_file.number, transfer.file);
  }
  of_file.armed = arm(*transfer.file, EPOLLIN | EPOLLET | (transfer.writes ? EPOLLOUT : 0U));
  return of_file.armed;
}

bool TapTransfers::arm(TappedFile& file, std::uint32_t events) {
  TappedFile::Watch& of_file = file.watch();
  epoll_event wanted{};
  wanted.events = events;
  wanted.data.u64 = of_file.number;
  const int fd = file.fd();
  if (of_file.kept) return ::epoll_ctl(ready_->get(), EPOLL_CTL_MOD, fd, &wanted) == 0;
  if (::epoll_ctl(ready_->get(), EPOLL_CTL_ADD, fd, &wanted) != 0) return false;
  of_file.kept = std::shared_ptr<void>(
      ready_.get(), [ready = ready_, fd](void*) { ::epoll_ctl(ready->get(), EPOLL_CTL_DEL, fd, nullptr); });
  return true;
}

void TapTransfers::on_ready() {
  std::array<epoll_event, 16> events{};
  int count = 0;
  do {
    count = ::epoll_wait(ready_->get(), events.data(), static_cast<int>(events.size()), 0);
    for (const epoll_event& event : std::span(events).first(static_cast<std::size_t>(std::max(count, 0)))) {
      const std::uint64_t number = event.data.u64;  // no reference: the structure is packed
      const auto found = watched_.find(number);
      if (found == watched_.end()) continue;
      if (const std::shared_ptr<TappedFile> file = found->second.lock()) on_ready_file(file);
    }
  } while (count == static_cast<int>(events.size()));
}

void TapTransfers::on_ready_file(const std::shared_ptr<TappedFile>& file) {
  bool is_waited_for = read_on(file);
  if (!writers_.empty() && writers_.front()->file == file) {
    is_waited_for = true;
    go_on(std::shared_ptr(writers_.front()));
  }
  if (is_waited_for) return;
  // A program that asks itself whether there is something does not need to hear of it here.
  file->watch().armed = false;
  (void)arm(*file, 0);
}

// In a tty, a read waits behind those that came before it. False: there was none.
bool TapTransfers::read_on(const std::shared_ptr<TappedFile>& file) {
  const auto reads = [&](const auto& transfer) { return !transfer->writes && transfer->file == file; };
  for (bool any = false;; any = true) {
    const auto first = std::ranges::find_if(kept_, reads);
    if (first == kept_.end()) return any;
    const std::shared_ptr<Transfer> transfer = *first;
    go_on(transfer);
    const auto waiting = transfer->kept.lock();
    if (waiting && !waiting->over()) return true;
  }
}

void TapTransfers::end(Transfer& transfer) {
  const auto is_it = [&](const auto& each) { return each.get() == &transfer; };
  const auto found = std::ranges::find_if(kept_, is_it);
  if (found == kept_.end()) return;
  const std::shared_ptr<Transfer> ended = *found;
  kept_.erase(found);
  let_go(transfer);
  const bool was_first = !writers_.empty() && writers_.front() == ended;
  std::erase_if(writers_, is_it);
  if (was_first && !writers_.empty()) go_on(std::shared_ptr(writers_.front()));
  if (kept_.empty()) calls_.on_idle();
}

void TapTransfers::go_on(const std::shared_ptr<Transfer>& transfer) {
  const std::shared_ptr<KeptCall> kept = transfer->kept.lock();
  if (!kept || kept->over()) return end(*transfer);
  if (transfer->writes && writers_.front() != transfer) return;  // its turn comes
  std::optional<Outcome> done = transfer->writes ? write_now(*transfer) : read_now(*transfer);
  if (!done) return wait(kept, transfer);
  let_go(*transfer);
  kept->finish(std::move(*done));
  end(*transfer);
}

void TapTransfers::let_go(Transfer& transfer) {
  if (const auto file = std::exchange(transfer.file, {})) files_->let_go(transfer.call, *file);
}

}  // namespace porttape
