#include "libport/supervise/tap_calls.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <dirent.h>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <linux/aio_abi.h>
#include <linux/openat2.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <sys/select.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/uio.h>
#include <system_error>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/tty_device.hpp"
#include "libport/supervise/caller_rights.hpp"
#include "libport/supervise/pending_signals.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

// Below FD_SETSIZE, for programs that select(), and above what others have.
constexpr std::uint32_t kFilesFrom = 960;
constexpr std::uint32_t kSelected = FD_SETSIZE;
constexpr std::uint32_t kFilesKept = 64;  // for it, where the limit is lower
constexpr rlim_t kFilesOfGuard = 32;      // which closes some before anybody answers
constexpr Nanos kHoldersLook = milliseconds(1);
constexpr int kRestrictSelf = 446;  // landlock_restrict_self, which older headers do not name

// The flags that openat2(2) knows; others are an error of its caller.
constexpr std::uint64_t kOpenFlags = O_ACCMODE | O_CREAT | O_EXCL | O_NOCTTY | O_TRUNC | O_APPEND |
                                     O_NONBLOCK | O_SYNC | O_DSYNC | O_ASYNC | O_DIRECT | O_LARGEFILE |
                                     O_DIRECTORY | O_NOFOLLOW | O_NOATIME | O_CLOEXEC | O_PATH | O_TMPFILE;

// What preadv2(2) and pwritev2(2) may be told that changes nothing for a tty.
constexpr std::uint64_t kNothingToTtys = RWF_HIPRI | RWF_DSYNC | RWF_SYNC;

// As many requests as the kernel lets all processes have by default (fs.aio-max-nr).
constexpr std::uint64_t kMostAioRequests = 65536;

std::uint32_t files_from_here() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= kFilesFrom + kFilesKept) return kFilesFrom;
  const rlim_t from = limit.rlim_cur > 2 * kFilesKept ? limit.rlim_cur - kFilesKept : limit.rlim_cur / 2;
  return static_cast<std::uint32_t>(std::max<rlim_t>(from, kFilesOfGuard));
}

// The descriptors that its process has open; nothing where /proc does not tell.
std::optional<std::set<std::uint32_t>> open_files(const Call& call) {
  const std::unique_ptr<DIR, int (*)(DIR*)> folder(
      ::opendir(fmt::format("/proc/{}/fd", call.thread()).c_str()), &::closedir);
  if (!folder) return std::nullopt;
  std::set<std::uint32_t> open;
  errno = 0;
  while (const dirent* const entry = ::readdir(folder.get())) {
    std::uint32_t fd = 0;
    const std::string_view name = entry->d_name;
    if (std::from_chars(name.data(), name.data() + name.size(), fd).ec == std::errc()) open.insert(fd);
  }
  return errno == 0 ? std::optional(std::move(open)) : std::nullopt;
}

// Nothing: that is not to be known.
std::optional<bool> is_open(const Call& call, std::uint32_t fd) {
  if (call.duplicate(static_cast<int>(fd))) return true;
  return errno == EBADF ? std::optional(false) : std::nullopt;
}

// The same without /proc, of the numbers that matter.
std::optional<std::set<std::uint32_t>> tried_files(const Call& call, std::uint32_t seen_from) {
  std::set<std::uint32_t> open;
  const auto add = [&](std::uint32_t fd) {
    const std::optional<bool> taken = is_open(call, fd);
    if (taken == true) open.insert(fd);
    return taken.has_value();
  };
  for (const std::uint32_t fd : {0U, 1U, 2U}) {
    if (!add(fd)) return std::nullopt;
  }
  for (std::uint32_t fd = seen_from; fd < seen_from + kFilesKept; ++fd) {
    if (!add(fd)) return std::nullopt;
  }
  return open;
}

// Flags with which no device is opened: as a place, as a folder, as a file that is to be made.
std::vector<std::uint32_t> no_device_opens() { return {O_PATH, O_DIRECTORY, O_CREAT | O_EXCL}; }

// The path of what is open here as `fd`.
std::optional<std::string> name_of(int fd) {
  std::array<char, 4096> name{};
  const ssize_t size = ::readlink(fmt::format("/proc/self/fd/{}", fd).c_str(), name.data(), name.size());
  if (size <= 0) return std::nullopt;
  return std::string(name.data(), static_cast<std::size_t>(size));
}

// To open another kind of device, only to see whether it is a tty, may do something.
bool is_other_kind(std::uint64_t device) {
  std::error_code error;
  const auto kind = std::filesystem::read_symlink(
      fmt::format("/sys/dev/char/{}:{}/subsystem", major(device), minor(device)), error);
  return !error && kind.filename() != "tty";
}

// Whether such an error of an open says nothing of the device, but something of this process or machine.
bool is_ours(int error) { return error == EMFILE || error == ENFILE || error == ENOMEM; }

bool is_seen(std::uint32_t fd, std::uint32_t seen_from) { return fd <= 2 || fd >= seen_from; }

bool lives(pid_t process) {
  const UniqueFd file(static_cast<int>(::syscall(SYS_pidfd_open, process, 0)));
  if (!file) return errno != ESRCH;
  pollfd ended{.fd = file.get(), .events = POLLIN, .revents = 0};
  return ::poll(&ended, 1, 0) == 0;
}

}  // namespace

std::optional<TapCalls::OpenArguments> TapCalls::open_arguments(const Call& call) {
#ifdef SYS_open
  if (call.number() == SYS_open || call.number() == SYS_creat) {
    const auto path = call.read_path(call.argument(0));
    if (!path) return std::nullopt;
    const int flags =
        call.number() == SYS_creat ? O_CREAT | O_WRONLY | O_TRUNC : static_cast<int>(call.argument(1));
    return OpenArguments{*path, AT_FDCWD, flags};
  }
#endif
  const auto path = call.read_path(call.argument(1));
  if (!path) return std::nullopt;
  std::uint64_t flags = call.argument(2);
  bool own_way = false;
  if (call.number() == SYS_openat2) {
    const auto how = call.read_as<open_how>(call.argument(2));
    if (!how || call.argument(3) < sizeof(open_how)) return std::nullopt;
    flags = how->flags;
    const bool makes = (flags & (O_CREAT | O_TMPFILE)) != 0;
    if ((flags & ~kOpenFlags) != 0 || (how->mode != 0 && !makes)) return std::nullopt;
    own_way = how->resolve != 0 || call.argument(3) > sizeof(open_how);
  }
  return OpenArguments{*path, static_cast<int>(call.argument(0)), static_cast<int>(flags), own_way};
}

TapCalls::TapCalls(Loop& loop, TappedLine& line, Options options)
    : loop_(&loop),
      line_(&line),
      files_(loop),
      transfers_(loop, line, files_,
                 {.on_idle = [this] { holders_timer_.set_after(kHoldersLook); },
                  .tell = [this](const std::string& what) { tell_once(what); }}),
      requests_(line, files_),
      options_(std::move(options)),
      files_from_(files_from_here()),
      device_(options_.device),
      holders_timer_(loop, [this] { look_for_holders(); }) {}

TapCalls::~TapCalls() = default;

std::vector<CallTrap> TapCalls::traps() const {
  std::vector<CallTrap> traps;
  for (const long number : {SYS_read, SYS_write})
    traps.push_back({static_cast<int>(number), {}, files_from_});
  std::vector<std::uint32_t> requests = TapRequests::requests();
  requests.push_back(FIONBIO);
  traps.push_back({.number = SYS_ioctl, .requests = std::move(requests)});
  for (const long number : {SYS_readv, SYS_writev, SYS_preadv2, SYS_pwritev2, SYS_dup, SYS_fcntl})
    traps.push_back({static_cast<int>(number), {}, files_from_});
  for (const long number : {
#ifdef SYS_dup2
           SYS_dup2,
#endif
           SYS_dup3})
    traps.push_back({.number = static_cast<int>(number), .files_from = files_from_, .or_second = true});
  for (const long number : {
#ifdef SYS_open
           SYS_creat,
#endif
           SYS_openat2, SYS_sendfile, SYS_splice, SYS_tee, SYS_copy_file_range, SYS_io_uring_setup,
           SYS_io_submit, SYS_pidfd_getfd, kRestrictSelf})
    traps.push_back({.number = static_cast<int>(number)});
#ifdef SYS_open
  traps.push_back({.number = SYS_open, .unless = {1, no_device_opens()}});
#endif
  traps.push_back({.number = SYS_openat, .unless = {2, no_device_opens()}});
  return traps;
}

bool TapCalls::is_tapped(const Call& call, int fd) const {
  if (!device_ || !line_->open()) return false;
  const std::optional<TtyDevice> found = call.device_of(fd);
  return found && found->is(*device_);
}

CallPart::Decision TapCalls::decide(Supervisor& supervisor, const Call& call) {
  switch (call.number()) {
#ifdef SYS_open
    case SYS_open:
    case SYS_creat:
#endif
    case SYS_openat:
    case SYS_openat2:
      return decide_open(supervisor, call);
    // At a place, which a tty has not.
    case SYS_preadv2:
    case SYS_pwritev2:
      if (static_cast<std::int64_t>(call.argument(3)) != -1) return outcome::Pass{};
      if ((call.argument(5) & ~kNothingToTtys) == 0) return decide_device(supervisor, call);
      if (is_tapped(call, static_cast<int>(call.argument(0))))
        tell_unseen(
            "the command used preadv2 or pwritev2 with flags of its own",
            "the command reads or writes its device by preadv2 or pwritev2 with flags of its own: that is "
            "not on the tape; record it by `porttape exec --device`");
      return outcome::Pass{};
    case SYS_read:
    case SYS_readv:
    case SYS_write:
    case SYS_writev:
    case SYS_ioctl:
      return decide_device(supervisor, call);
    case SYS_dup:
    case SYS_dup3:
#ifdef SYS_dup2
    case SYS_dup2:
#endif
    case SYS_fcntl:
      return decide_copy(call);
    // Programs that use these do it another way where they are told so.
    case SYS_sendfile:
    case SYS_splice:
    case SYS_tee:
    case SYS_copy_file_range: {
      const auto other = static_cast<int>(
          call.argument(call.number() == SYS_splice || call.number() == SYS_copy_file_range ? 2 : 1));
      if (is_tapped(call, static_cast<int>(call.argument(0))) || is_tapped(call, other))
        return outcome::Refuse{EINVAL};
      return outcome::Pass{};
    }
    case SYS_io_uring_setup:
      return outcome::Refuse{ENOSYS};
    case SYS_io_submit:
      if (submits_to_device(call)) return outcome::Refuse{EINVAL};
      return outcome::Pass{};
    case SYS_pidfd_getfd:
      if (takes_device(call))
        tell_unseen("the command took its device from another process",
                    "the command takes its device from another process (pidfd_getfd): what it says by that "
                    "descriptor is not on the tape; record it by `porttape exec --device`");
      return outcome::Pass{};
    case kRestrictSelf:
      if (const std::vector<pid_t> lineage = lineage_of(call.thread()); !lineage.empty())
        restricted_.insert(lineage.front());
      return outcome::Pass{};
    default:
      return NotMine{};
  }
}

// As io_submit(2) reads them: a pointer to each request.
bool TapCalls::submits_to_device(const Call& call) const {
  if (!device_ || !line_->open()) return false;
  const std::uint64_t count = std::min(call.argument(1), kMostAioRequests);
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto at = call.read_as<std::uint64_t>(call.argument(2) + i * sizeof(std::uint64_t));
    const auto request = at ? call.read_as<iocb>(*at) : std::nullopt;
    if (!request) return false;  // which the kernel finds, too
    if (is_tapped(call, static_cast<int>(request->aio_fildes))) return true;
  }
  return false;
}

// Whether that is the device, as far as we may look there.
bool TapCalls::takes_device(const Call& call) const {
  if (!device_ || !line_->open()) return false;
  const UniqueFd process = call.duplicate(static_cast<int>(call.argument(0)));
  const UniqueFd file(
      process ? static_cast<int>(::syscall(SYS_pidfd_getfd, process.get(), call.argument(1), 0)) : -1);
  const std::optional<TtyDevice> found = file ? tty_device_of(file.get()) : std::nullopt;
  return found && found->is(*device_);
}

CallPart::Decision TapCalls::decide_open(Supervisor& supervisor, const Call& call) {
  std::optional<OpenArguments> wanted = open_arguments(call);
  if (!wanted && call.is_closed())
    tell_once(
        "a program that lets nobody look into its memory opens files: if its device is among them, that is "
        "not on the tape; record it by `porttape exec --device`");
  const auto has = [&](std::uint32_t mask) {
    return (static_cast<std::uint32_t>(wanted->flags) & mask) == mask;
  };
  if (!wanted || std::ranges::any_of(no_device_opens(), has)) return outcome::Pass{};
  wanted->file = program_file(call.thread(), wanted->named, wanted->folder);
  const QuickLook look = look_at_once(wanted->file);
  if (!look.known) return look_elsewhere(supervisor, call, *std::move(wanted));
  if (!look.device) return outcome::Pass{};
  return decide_device_open([&] { return supervisor.keep(call); }, call, *wanted, *look.device);
}

// The program waits for the file system, and nobody else does.
CallPart::Decision TapCalls::look_elsewhere(Supervisor& supervisor, const Call& call, OpenArguments wanted) {
  struct Found {
    OpenArguments wanted;
    std::optional<TtyDevice> device;
  };
  const auto found = std::make_shared<Found>(Found{std::move(wanted), std::nullopt});
  const std::shared_ptr<KeptCall> kept = supervisor.keep(call);
  kept->restarts_always(true);
  const auto look = [found, thread = call.thread()] {
    OpenArguments& open = found->wanted;
    open.file = own_file(thread, open.file);
    open.through_process = !open.file.in_proc && leads_through_process(open.file);
    open.may_wait = true;
    found->device = tty_device_at(open.file);
  };
  const auto done = [this, found, waiting = std::weak_ptr(kept), alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) looked(waiting, found->wanted, found->device);
  };
  if (!loop_->run_elsewhere(Workers::Strand(), look, done)) {
    tell_once(
        "no thread was to be had to look at a file that the command opens: if that is its device, what it "
        "says is not on the tape");
    kept->finish(outcome::Pass{});
  }
  return Kept{};
}

void TapCalls::looked(const std::weak_ptr<KeptCall>& waiting, const OpenArguments& wanted,
                      const std::optional<TtyDevice>& device) {
  const std::shared_ptr<KeptCall> kept = waiting.lock();
  if (!kept || kept->over()) return;
  kept->restarts_always(false);
  if (!device) return kept->finish(outcome::Pass{});
  Decision decision = decide_device_open([&kept] { return kept; }, kept->call(), wanted, *device);
  if (auto* const outcome = std::get_if<Outcome>(&decision)) kept->finish(std::move(*outcome));
}

CallPart::Decision TapCalls::decide_device_open(const Keep& keep, const Call& call,
                                                const OpenArguments& wanted, const TtyDevice& device) {
  if (device_ ? !device.is(*device_) : !ports_.can_be(device.number)) return outcome::Pass{};
  if (call.is_small()) {
    tell_unseen("a 32-bit program has opened the device",
                "a 32-bit program opens its device: what it says is not on the tape; record it by "
                "`porttape exec --device`");
    return outcome::Pass{};
  }
  if (!device_ && is_other_kind(device.number)) return outcome::Pass{};
  // The system says nothing of a program that was killed meanwhile, so the reason would be wrong.
  if (const std::string why = why_not_opened(call, wanted); !why.empty()) {
    if (!call.waits()) return outcome::Pass{};
    tell_unseen(
        fmt::format("the command has opened the device where it is not seen ({})", why),
        fmt::format("the command opens its device where that cannot be done for it ({}): what it says then "
                    "is not on the tape; record it by `porttape exec --device`",
                    why));
    return outcome::Pass{};
  }
  const std::optional<Place> place = place_for(call, 0);
  if (!place) {
    tell_no_place(call);
    return outcome::Pass{};
  }
  if (place->kind == Place::Kind::none) return outcome::Pass{};  // which the kernel refuses, too
  return open_tapped(keep, call, wanted, device);
}

// Where what is said is seen. The number is the lowest free one, as programs count on for 0 to 2 and have it
// where they have many files. The kernel finds that one, since other threads take and free numbers meanwhile.
// Else it is the highest free one below FD_SETSIZE: a number that another thread could be given meanwhile
// only if it opened all that are between. Nothing: there is none, or it is not to be known.
std::optional<TapCalls::Place> TapCalls::place_for(const Call& call, std::uint32_t from) const {
  rlimit limit{};
  if (::prlimit(process_of(call.thread()), RLIMIT_NOFILE, nullptr, &limit) != 0)
    limit.rlim_cur = RLIM_INFINITY;
  std::optional<std::set<std::uint32_t>> open = open_files(call);
  if (!open) open = tried_files(call, files_from_);
  if (!open) return std::nullopt;
  std::uint32_t lowest = from;
  while (open->contains(lowest)) ++lowest;
  if (lowest >= limit.rlim_cur) return Place{Place::Kind::none, 0};
  if (is_seen(lowest, files_from_)) return Place{};
  const auto end = static_cast<std::uint32_t>(std::min<rlim_t>(limit.rlim_cur, kSelected));
  for (std::uint32_t fd = end; fd-- > std::max(files_from_, from);) {
    if (!open->contains(fd)) return Place{Place::Kind::number, static_cast<int>(fd)};
  }
  for (std::uint32_t fd = std::max(kSelected, from); fd < limit.rlim_cur; ++fd) {
    if (!open->contains(fd)) return Place{Place::Kind::number, static_cast<int>(fd)};
  }
  return std::nullopt;
}

Outcome TapCalls::install(UniqueFd file, const Place& place, bool close_on_exec) {
  const auto given = [this](int number) {
    if (!is_seen(static_cast<std::uint32_t>(number), files_from_)) tell_moved(number);
  };
  const bool named = place.kind == Place::Kind::number;
  return outcome::Install{std::move(file), named ? std::optional(place.at) : std::nullopt, close_on_exec,
                          given};
}

// Landlock holds for who restricts itself, and for all that it starts from then on.
std::string TapCalls::why_not_opened(const Call& call, const OpenArguments& wanted) const {
  if (wanted.own_way) return "by a path with rules of its own";
  if (wanted.through_process) return "by a link to what a process has open";
  if (!restricted_.empty()) {
    const std::vector<pid_t> lineage = lineage_of(call.thread());
    if (std::ranges::any_of(lineage, [this](pid_t process) { return restricted_.contains(process); }))
      return "it has restricted itself by Landlock";
  }
  return why_not_ours(call.thread());
}

// A tty may wait for its carrier, which a pty does not have, and the way to it for a file system.
CallPart::Decision TapCalls::open_tapped(const Keep& keep, const Call& call, const OpenArguments& wanted,
                                         const TtyDevice& device) {
  if ((wanted.flags & O_NOCTTY) == 0 && gets_terminal(call.thread()))
    tell_once(
        "the command's device does not become its controlling terminal, as without --tap: a hang-up sends "
        "it no SIGHUP");
  if (!wanted.may_wait && ((wanted.flags & O_NONBLOCK) != 0 || is_pty(device.number))) {
    const int flags = wanted.flags & ~(O_CREAT | O_EXCL | O_TRUNC);
    UniqueFd file(::openat(wanted.file.at(), wanted.file.path.c_str(), flags | O_NOCTTY | O_CLOEXEC));
    if (!file && is_ours(errno)) return not_opened_here(errno);
    if (!file) return outcome::Refuse{errno};
    return opened(call, wanted, device, std::move(file));
  }
  const std::shared_ptr<KeptCall> kept = keep();
  const auto done = [this, weak = std::weak_ptr(kept), wanted, device](UniqueFd file, int error) {
    holders_timer_.set_after(kHoldersLook);  // which lets go of it
    const auto waiting = weak.lock();
    if (!waiting || waiting->over()) return;
    if (!file && is_ours(error)) return waiting->finish(not_opened_here(error));
    waiting->finish(file ? opened(waiting->call(), wanted, device, std::move(file))
                         : Outcome(outcome::Refuse{error == EINTR ? KeptCall::kRestart : error}));
  };
  std::unique_ptr<WaitingOpen> open = WaitingOpen::start(*loop_, wanted.file, wanted.flags, done);
  if (!open) {
    kept->finish(not_opened_here(errno));
    return Kept{};
  }
  kept->on_gone([this, of_it = open.get()] {
    std::erase_if(opens_, [&](const auto& each) { return each.get() == of_it; });
  });
  opens_.push_back(std::move(open));
  return Kept{};
}

// The program opens it by itself then.
Outcome TapCalls::not_opened_here(int error) {
  const std::string why = "porttape could not open the device (" + errno_text(error) + ")";
  tell_unseen(why, why + ": what the command says to it is not on the tape");
  return outcome::Pass{};
}

Outcome TapCalls::opened(const Call& call, const OpenArguments& wanted, const TtyDevice& device,
                         UniqueFd file) {
  termios made{};
  if (::tcgetattr(file.get(), &made) != 0 && errno == ENOTTY) return outcome::Pass{};
  device_ = device;
  if (line_->open()) look_for_holders();  // it may be this close and open again
  if (line_->open() && line_->lost()) line_->closed();
  if (!line_->open()) begin_line(file.get(), wanted.named);
  watch_closes(file.get());
  watch_process(process_of(call.thread()));
  const std::optional<Place> place = place_for(call, 0);
  if (!place) tell_no_place(call);
  return install(std::move(file), place.value_or(Place{}), (wanted.flags & O_CLOEXEC) != 0);
}

void TapCalls::begin_line(int file, const std::string& path) {
  line_->opened(name_of(file).value_or(path), TapRequests::settings_of(file));
  requests_.tell_first_lines(file);
}

// Closes are not trapped: a signal that comes before a trapped call is received ends it with EINTR, which no
// program expects of close(). Instead the kernel tells when the last descriptor of an open file is gone. The
// watch stays for the next open, since ending one takes milliseconds.
void TapCalls::watch_closes(int file) {
  const std::optional<std::string> name = name_of(file);
  std::unique_ptr<FileEvents::Watch>& watch = closes_[name.value_or("")];
  if (!name || watch) return;
  watch = loop_->file_events().watch_closes(*name);
  watch->on_event([this, events = watch.get()] {
    (void)events->take();
    if (line_->open() && !holders_timer_.due()) holders_timer_.set_after(kHoldersLook);
  });
}

// The system says nothing of a program that was killed meanwhile.
void TapCalls::tell_no_place(const Call& call) {
  if (!call.waits()) return;
  tell_unseen(
      "the command had the device by a descriptor that is not seen",
      "the command may have no descriptor where what it says to its device is seen (its limit of open files "
      "is too low, or /proc is not to be had): record it by `porttape exec --device` instead");
}

void TapCalls::tell_moved(int at) {
  tell_unseen("the command had the device by a descriptor that is not seen",
              fmt::format("the command has moved its device to descriptor {}, where what it reads and writes "
                          "is not seen: record it by `porttape exec --device` instead",
                          at));
}

// A copy is where reads and writes of it are seen, too.
CallPart::Decision TapCalls::decide_copy(const Call& call) {
  const auto fd = static_cast<int>(call.argument(0));
  const auto at = static_cast<std::uint32_t>(call.argument(call.number() == SYS_fcntl ? 2 : 1));
  const auto command = static_cast<int>(call.argument(1));
  const bool is_fcntl = call.number() == SYS_fcntl;
  if (is_fcntl && (command == F_GETFL || command == F_SETFL)) return decide_flags(call);
  if (is_fcntl && command != F_DUPFD && command != F_DUPFD_CLOEXEC) return outcome::Pass{};
  if (!is_tapped(call, fd)) return outcome::Pass{};
  if (!is_fcntl && call.number() != SYS_dup) {
    if (!is_seen(at, files_from_)) tell_moved(static_cast<int>(at));
    return outcome::Pass{};
  }
  const std::uint32_t from = is_fcntl ? at : 0;
  const std::optional<Place> place = place_for(call, from);
  UniqueFd copy = call.duplicate(fd);
  if (!place || !copy) {
    tell_no_place(call);
    return outcome::Pass{};
  }
  // The kernel finds the lowest one from a number on only by itself.
  if (place->kind == Place::Kind::none || (place->kind == Place::Kind::lowest && from > 0))
    return outcome::Pass{};
  return install(std::move(copy), *place, is_fcntl && command == F_DUPFD_CLOEXEC);
}

// Here, since what a transfer makes of them meanwhile must not be seen.
CallPart::Decision TapCalls::decide_flags(const Call& call) {
  const auto fd = static_cast<int>(call.argument(0));
  if (!is_tapped(call, fd)) return outcome::Pass{};
  const UniqueFd file = call.duplicate(fd);
  if (!file) return outcome::Pass{};
  const auto command = static_cast<int>(call.argument(1));
  const auto flags = static_cast<int>(call.argument(2));
  // Whom it signals is told from the caller.
  if (command == F_SETFL && (flags & O_ASYNC) != 0) return outcome::Pass{};
  const int result = command == F_GETFL ? ::fcntl(file.get(), F_GETFL) : ::fcntl(file.get(), F_SETFL, flags);
  if (result < 0) return outcome::Refuse{errno};
  return Outcome(outcome::Answer{result});
}

CallPart::Decision TapCalls::set_non_blocking(const Call& call, const TappedFile& file) {
  const auto on = call.read_as<int>(call.argument(2));
  if (!on) return outcome::Refuse{EFAULT};
  if (::ioctl(file.fd(), FIONBIO, &*on) != 0) return outcome::Refuse{errno};
  return Outcome(outcome::Answer{0});
}

// What is done to the device itself.
CallPart::Decision TapCalls::decide_device(Supervisor& supervisor, const Call& call) {
  const bool is_request = call.number() == SYS_ioctl;
  const auto not_ours = [&] { return is_request ? Decision(NotMine{}) : Decision(outcome::Pass{}); };
  if (!device_) return not_ours();
  int error = 0;
  const std::shared_ptr<TappedFile> file = files_.find(call, *device_, error);
  if (!file) {
    if (error == 0 || !is_tapped(call, static_cast<int>(call.argument(0)))) return not_ours();
    tell_unseen("the command's descriptors were not to be had",
                "its descriptors are not to be had (" + errno_text(error) +
                    "): what the command says to its device is not on the tape");
    return outcome::Pass{};
  }
  if (!line_->open()) {  // it had it before, or was not to be found in /proc
    begin_line(file->fd(), {});
    watch_closes(file->fd());
    watch_process(process_of(call.thread()));
  }
  Decision decision = !is_request ? transfers_.decide(supervisor, call, file)
                      : static_cast<std::uint32_t>(call.argument(1)) == FIONBIO
                          ? set_non_blocking(call, *file)
                          : requests_.decide(supervisor, call, file);
  if (!std::holds_alternative<Kept>(decision)) files_.let_go(call, *file);
  return decision;
}

// Whether it has the device open, as far as that is to be known.
bool TapCalls::holds(pid_t process) const {
  std::error_code error;
  for (std::filesystem::directory_iterator each(fmt::format("/proc/{}/fd", process), error), end;
       !error && each != end; each.increment(error)) {
    const std::optional<TtyDevice> found = tty_device_at(each->path());
    if (found && found->is(*device_)) return true;
  }
  return error && error != std::errc::no_such_file_or_directory && lives(process);
}

// At its end the device may be closed.
void TapCalls::watch_process(pid_t process) {
  if (std::ranges::any_of(holders_, [&](const auto& each) { return each->process == process; })) return;
  auto holder = std::make_unique<Holder>();
  holder->process = process;
  holder->file.reset(static_cast<int>(::syscall(SYS_pidfd_open, process, 0)));
  if (!holder->file) return holders_timer_.set_after(kHoldersLook);
  holder->watch.emplace(*loop_, holder->file.get(), [this, process] {
    const auto of_it = [&](const auto& each) { return each->process == process; };
    const auto found = std::ranges::find_if(holders_, of_it);
    if (found == holders_.end()) return;
    (*found)->watch->watch_readable(false);
    (*found)->over = true;
    holders_timer_.set_after(kHoldersLook);
  });
  holder->watch->watch_readable(true);
  holders_.push_back(std::move(holder));
}

void TapCalls::look_for_holders() {
  std::erase_if(holders_, [](const auto& each) { return each->over; });
  std::erase_if(opens_, [](const auto& each) { return each->over(); });
  if (!line_->open() || transfers_.any_waits()) return;
  // While this looks through all processes, a signal may end a call that nobody has received yet.
  if (std::ranges::any_of(holders_, [this](const auto& each) { return holds(each->process); })) return;
  for (const pid_t process : options_.processes()) {
    if (holds(process)) return watch_process(process);
  }
  holders_timer_.cancel();
  line_->closed();
}

// Bytes that are not on the tape.
void TapCalls::tell_unseen(const std::string& why, const std::string& what) {
  line_->unseen(why);
  tell_once(what);
}

void TapCalls::tell_once(const std::string& what) {
  if (std::ranges::find(told_, what) != told_.end()) return;
  told_.push_back(what);
  options_.tell(what);
}

}  // namespace porttape
