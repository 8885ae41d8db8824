#include "libport/supervise/probe_calls.hpp"

#include <algorithm>
#include <array>
#include <asm/ioctls.h>
#include <asm/termbits.h>
#include <chrono>
#include <climits>
#include <fmt/format.h>
#include <fstream>
#include <optional>
#include <span>
#include <sstream>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include "libport/base/tty_device.hpp"

namespace porttape {
namespace {

using Effect = ProbeFindings::Effect;

struct ProbedRequest {
  std::uint32_t request;
  std::string_view name;
  Effect effect;
  std::string_view on_pty;
};

constexpr std::string_view kNoLines = "fails: it has no modem lines";
constexpr std::string_view kNoBreak = "succeeds, no break is sent";
constexpr std::string_view kNoSerial = "fails: it has no UART";
constexpr std::string_view kFlush = "drops bytes that were written and not yet passed on";
constexpr std::array kProbedRequests{
    ProbedRequest{TIOCMGET, "TIOCMGET", Effect::lacks, kNoLines},
    ProbedRequest{TIOCMSET, "TIOCMSET", Effect::lacks, kNoLines},
    ProbedRequest{TIOCMBIS, "TIOCMBIS", Effect::lacks, kNoLines},
    ProbedRequest{TIOCMBIC, "TIOCMBIC", Effect::lacks, kNoLines},
    ProbedRequest{TIOCMIWAIT, "TIOCMIWAIT", Effect::lacks, kNoLines},
    ProbedRequest{TIOCGICOUNT, "TIOCGICOUNT", Effect::lacks, "fails: it counts no interrupts"},
    ProbedRequest{TIOCGSERIAL, "TIOCGSERIAL", Effect::lacks, kNoSerial},
    ProbedRequest{TIOCSSERIAL, "TIOCSSERIAL", Effect::lacks, kNoSerial},
    ProbedRequest{TIOCGRS485, "TIOCGRS485", Effect::lacks, kNoSerial},
    ProbedRequest{TIOCSRS485, "TIOCSRS485", Effect::lacks, kNoSerial},
    ProbedRequest{TCSBRKP, "TCSBRKP", Effect::bends, kNoBreak},
    ProbedRequest{TIOCSBRK, "TIOCSBRK", Effect::bends, kNoBreak},
    ProbedRequest{TIOCCBRK, "TIOCCBRK", Effect::bends, kNoBreak},
    ProbedRequest{TCFLSH, "TCFLSH", Effect::bends, kFlush},
    ProbedRequest{TIOCEXCL, "TIOCEXCL", Effect::same, "as on a device"}};

constexpr std::array<std::uint32_t, 9> kSettingRequests{TCSETS,   TCSETSW, TCSETSF, TCSETS2, TCSETSW2,
                                                        TCSETSF2, TCSETA,  TCSETAW, TCSETAF};

struct ProbedPath {
  std::string_view begin;
  std::string_view name;
  Effect effect;
  std::string_view on_pty;
};
constexpr std::string_view kOtherName = "has another name";
constexpr std::size_t kMostNames = 8;
constexpr std::string_view kNotListed = "is not listed there";
constexpr std::array kProbedPaths{
    ProbedPath{"/sys/class/tty", "looks in /sys/class/tty", Effect::finds, kNotListed},
    ProbedPath{"/sys/bus/usb", "looks in /sys/bus/usb*", Effect::finds, kNotListed},
    ProbedPath{"/run/udev/", "asks udev", Effect::finds, kNotListed},
    ProbedPath{"/dev/serial/", "looks in /dev/serial", Effect::finds, kNotListed},
    ProbedPath{"/var/lock/LCK..", "lock file LCK..", Effect::same, "as on a device"},
    ProbedPath{"/run/lock/LCK..", "lock file LCK..", Effect::same, "as on a device"}};
constexpr std::array<std::string_view, 8> kDeviceNames{"ttyS",   "ttyUSB", "ttyACM", "ttyAMA",
                                                       "ttymxc", "ttyXR",  "ttyO",   "rfcomm"};

// "/dev/ttyUSB0", not "/dev/ttyUSB" nor "/dev/tty".
bool is_device_name(std::string_view path) {
  constexpr std::string_view kDev = "/dev/";
  if (!path.starts_with(kDev)) return false;
  path.remove_prefix(kDev.size());
  for (const std::string_view begin : kDeviceNames) {
    if (path.starts_with(begin) && path.size() > begin.size() && path[begin.size()] >= '0' &&
        path[begin.size()] <= '9')
      return true;
  }
  return false;
}

// Which argument is a path; -1: none.
int path_argument(int number) {
  switch (number) {
#ifdef SYS_open
    case SYS_open:
    case SYS_stat:
    case SYS_lstat:
    case SYS_access:
    case SYS_readlink:
      return 0;
#endif
    case SYS_openat:
    case SYS_newfstatat:
    case SYS_statx:
    case SYS_faccessat:
    case SYS_faccessat2:
    case SYS_readlinkat:
      return 1;
    default:
      return -1;
  }
}

}  // namespace

bool ProbeFindings::any(Effect effect) const {
  return std::ranges::find(rows, effect, &Row::effect) != rows.end();
}

std::string ProbeFindings::naming(std::string_view path) { return fmt::format("names {}", path); }

std::string_view name_of(ProbeFindings::Effect effect) {
  switch (effect) {
    case Effect::lacks:
      return "lacks";
    case Effect::bends:
      return "bends";
    case Effect::finds:
      return "finds";
    case Effect::same:
      break;
  }
  return "same";
}

ProbeCalls::ProbeCalls(ProbeFindings& findings, const Clock& clock)
    : findings_(findings), clock_(&clock), start_(clock.now()) {}

std::vector<CallTrap> ProbeCalls::traps() const {
  CallTrap requests{.number = SYS_ioctl};
  for (const ProbedRequest& probed : kProbedRequests) requests.requests.push_back(probed.request);
  requests.requests.push_back(TCSBRK);
  requests.requests.insert(requests.requests.end(), kSettingRequests.begin(), kSettingRequests.end());
  std::vector<CallTrap> traps{std::move(requests)};
  for (const int number : {
#ifdef SYS_open
           SYS_open, SYS_stat, SYS_lstat, SYS_access, SYS_readlink,
#endif
           SYS_openat, SYS_newfstatat, SYS_statx, SYS_faccessat, SYS_faccessat2, SYS_readlinkat,
           SYS_io_uring_setup})
    traps.push_back({.number = number});
  return traps;
}

CallPart::Decision ProbeCalls::decide(Supervisor&, const Call& call) {
  const int argument = path_argument(call.number());
  if (call.number() == SYS_ioctl)
    look_at_request(call);
  else if (call.number() == SYS_io_uring_setup)
    note("io_uring_setup", Effect::same, "what goes by the ring is not seen here");
  else if (argument >= 0)
    look_at_path(call, call.argument(static_cast<std::size_t>(argument)));
  return NotMine{};
}

void ProbeCalls::look_at_request(const Call& call) {
  const int fd = static_cast<int>(call.argument(0));
  const std::optional<TtyDevice> device = call.device_of(fd);
  if (!device || !ports_.can_be(device->number)) return;
  note_port(call, fd, is_pty(device->number));
  const auto request = static_cast<std::uint32_t>(call.argument(1));
  if (request == TCSBRK) {
    if (call.argument(2) == 0) return note("TCSBRK (break)", Effect::bends, kNoBreak);
    return note("TCSBRK (drain)", Effect::bends, "is over at once, whatever the device has");
  }
  const auto* const probed = std::ranges::find(kProbedRequests, request, &ProbedRequest::request);
  if (probed != kProbedRequests.end()) return note(probed->name, probed->effect, probed->on_pty);
  look_at_settings(call, request);
}

void ProbeCalls::look_at_settings(const Call& call, std::uint32_t request) {
  std::optional<std::uint32_t> flags;
  if (request == TCSETA || request == TCSETAW || request == TCSETAF) {
    const auto modes = call.read_as<std::array<std::uint16_t, 4>>(call.argument(2));
    if (modes) flags = (*modes)[2];
  } else {
    const auto modes = call.read_as<std::array<std::uint32_t, 4>>(call.argument(2));
    if (modes) flags = (*modes)[2];
  }
  if (!flags) return;
  if ((*flags & PARENB) != 0) note("parity", Effect::bends, "is cleared: the read-back differs");
  if ((*flags & CSIZE) != CS8) note("5 to 7 data bits", Effect::bends, "are 8: the read-back differs");
  if ((*flags & CSTOPB) != 0) note("2 stop bits", Effect::same, "are kept, and mean nothing");
  if ((*flags & CRTSCTS) != 0) note("RTS/CTS flow control", Effect::bends, "is kept, and holds nothing up");
  if ((*flags & CBAUD) == B0) note("speed 0", Effect::bends, "does not drop DTR and RTS");
  if ((*flags & CBAUD) == BOTHER) note("a speed of its own", Effect::same, "is kept");
  if (request == TCSETSF || request == TCSETSF2 || request == TCSETAF)
    note("settings with flush", Effect::same, "drop what came and was not read");
}

void ProbeCalls::look_at_path(const Call& call, std::uint64_t address) {
  const std::optional<std::string> path = call.read_path(address);
  if (!path) return;
  if (path->ends_with("/latency_timer")) return note("latency_timer", Effect::finds, "has none");
  if (is_device_name(*path)) {
    const bool known = std::ranges::find(findings_.names, *path) != findings_.names.end();
    if (!known && findings_.names.size() == kMostNames)
      return note("names more ports", Effect::finds, kOtherName);
    if (!known) findings_.names.push_back(*path);
    return note(ProbeFindings::naming(*path), Effect::finds, kOtherName);
  }
  for (const ProbedPath& probed : kProbedPaths) {
    if (path->starts_with(probed.begin)) return note(probed.name, probed.effect, probed.on_pty);
  }
}

void ProbeCalls::note(std::string_view call, Effect effect, std::string_view on_pty) {
  auto row = std::ranges::find(findings_.rows, call, &ProbeFindings::Row::call);
  if (row == findings_.rows.end()) {
    findings_.rows.push_back({.call = std::string(call),
                              .effect = effect,
                              .on_pty = on_pty,
                              .count = 0,
                              .first = clock_->now() - start_});
    row = findings_.rows.end() - 1;
  }
  ++row->count;
}

void ProbeCalls::note_port(const Call& call, int fd, bool pty) {
  std::array<char, 256> name{};
  const ssize_t size =
      ::readlink(fmt::format("/proc/{}/fd/{}", call.thread(), fd).c_str(), name.data(), name.size());
  if (size <= 0) return;
  const std::string text(name.data(), static_cast<std::size_t>(size));
  if (std::ranges::find(findings_.ports, text, &ProbeFindings::Port::name) == findings_.ports.end())
    findings_.ports.push_back({text, pty});
}

}  // namespace porttape
