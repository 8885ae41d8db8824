#include "libport/supervise/tap_requests.hpp"

#include <array>
#include <asm/termbits.h>
#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <optional>
#include <span>
#include <sys/ioctl.h>
#include <utility>

#include "libport/supervise/event_requests.hpp"
#include "libport/supervise/settings_form.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

constexpr Nanos kSentLook = milliseconds(1);
constexpr Nanos kBreak = milliseconds(250);  // of a TCSBRK, and a TCSBRKP of 0: tty_io.c of the kernel's
constexpr Nanos kTenth = milliseconds(100);
constexpr int kDriven = TIOCM_DTR | TIOCM_RTS;

constexpr std::array<std::uint32_t, 19> kTapped{
    TCSETS,  TCSETSW,  TCSETSF,  TCSETA,   TCSETAW,  TCSETAF,  TCSETS2,  TCSETSW2,    TCSETSF2, TCSBRK,
    TCSBRKP, TIOCSBRK, TIOCCBRK, TIOCMGET, TIOCMSET, TIOCMBIS, TIOCMBIC, TIOCGICOUNT, FIONBIO};

LineSettings settings_at(int fd, tcflag_t flags) {
  LineSettings settings;
  if (const Result<ShownSettings> shown = shown_settings(fd)) settings = shown->settings.over(settings);
  settings.data_bits = data_bits_of(flags);
  settings.parity = parity_of(flags);
  return settings;
}

// By the kernel's own reading of it, on a line that is nobody's; where none is to be had, what the device
// has.
LineSettings settings_in(std::uint32_t request, const std::byte* made, int device) {
  const UniqueFd line(::open("/dev/ptmx", O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (!line || ::ioctl(line.get(), request, made) != 0)
    return settings_at(device, flags_in(form_of(request), made));
  return settings_at(line.get(), flags_in(form_of(request), made));
}

std::optional<int> lines_of(int fd) {
  int bits = 0;
  return ::ioctl(fd, TIOCMGET, &bits) == 0 ? std::optional(bits) : std::nullopt;
}

// The kernel tells of no end of it: its queue is looked at. What the UART still has is not seen here.
void when_sent(const std::weak_ptr<KeptCall>& kept, const std::shared_ptr<TappedFile>& file,
               const std::function<void()>& then) {
  const auto waiting = kept.lock();
  if (!waiting || waiting->over()) return;
  int left = 0;
  if (::ioctl(file->fd(), TIOCOUTQ, &left) != 0 || left == 0) return then();
  waiting->call_after(kSentLook, [kept, file, then] { when_sent(kept, file, then); });
}

}  // namespace

std::vector<std::uint32_t> TapRequests::requests() {
  std::vector<std::uint32_t> requests(kTapped.begin(), kTapped.end());
  for (const EventRequest& each : kEventRequests) requests.push_back(each.request);
  return requests;
}

LineSettings TapRequests::settings_of(int file) {
  termios made{};
  return ::ioctl(file, TCGETS, &made) == 0 ? settings_at(file, made.c_cflag) : LineSettings();
}

void TapRequests::tell_first_lines(int file) {
  if (const std::optional<int> bits = lines_of(file)) tell_signals(*bits, true);
}

CallPart::Decision TapRequests::decide(Supervisor& supervisor, const Call& call,
                                       const std::shared_ptr<TappedFile>& file) {
  const auto request = static_cast<std::uint32_t>(call.argument(1));
  if (const EventRequest* const event = event_request(request)) return make(*event, call, *file);
  switch (request) {
    case TIOCMGET:
      return give_lines(call, *file);
    case TIOCMSET:
    case TIOCMBIS:
    case TIOCMBIC:
      return drive_lines(call, *file, request);
    case TIOCGICOUNT:  // which counts their changes
      if (const std::optional<int> bits = lines_of(file->fd())) tell_signals(*bits, false);
      return outcome::Pass{};
    case TIOCSBRK:
      return begin_break_when_sent(supervisor, call, file);
    case TIOCCBRK:
      return set_break(*file, false);
    case TCSBRK:
      if (call.argument(2) != 0) return drain(supervisor, call, file);
      return send_break(supervisor, call, file, kBreak);
    case TCSBRKP: {
      const auto tenths = static_cast<int>(call.argument(2));
      return send_break(supervisor, call, file, tenths > 0 ? kTenth * tenths : kBreak);
    }
    default:
      return make_settings(call, *file, request);
  }
}

// Those that wait for the last byte to be sent are the kernel's.
Outcome TapRequests::make_settings(const Call& call, const TappedFile& file, std::uint32_t request) {
  const SettingsForm form = form_of(request);
  std::array<std::byte, sizeof(termios2)> made{};
  if (!call.read(call.argument(2), std::span(made).first(form.size))) return outcome::Refuse{EFAULT};
  const std::uint32_t at_once = made_at_once(request);
  if (at_once == request && ::ioctl(file.fd(), request, made.data()) != 0) return outcome::Refuse{errno};
  if (flushes_input(request)) line_->driver_did(line::Flush{FlushQueue::in});
  line_->made(settings_in(at_once, made.data(), file.fd()));
  return at_once == request ? Outcome(outcome::Answer{0}) : Outcome(outcome::Pass{});
}

Outcome TapRequests::make(const EventRequest& request, const Call& call, const TappedFile& file) {
  const auto argument = static_cast<int>(call.argument(2));
  if (::ioctl(file.fd(), request.request, argument) != 0) return outcome::Refuse{errno};
  if (const auto event = request.event(argument)) line_->driver_did(*event);
  return outcome::Answer{0};
}

Outcome TapRequests::set_break(const TappedFile& file, bool on) {
  if (::ioctl(file.fd(), on ? TIOCSBRK : TIOCCBRK, 0) != 0) return outcome::Refuse{errno};
  line_->driver_did(LineSignal{LineSignal::Name::brk, on});
  return outcome::Answer{0};
}

// The kernel's own waits for what was written.
CallPart::Decision TapRequests::begin_break_when_sent(Supervisor& supervisor, const Call& call,
                                                      const std::shared_ptr<TappedFile>& file) {
  int left = 0;
  if (::ioctl(file->fd(), TIOCOUTQ, &left) != 0 || left == 0) return set_break(*file, true);
  const std::weak_ptr kept(supervisor.keep_until_signal(call));
  when_sent(kept, file, [this, kept, file] { finish(kept, *file, set_break(*file, true)); });
  return CallPart::Kept{};
}

Outcome TapRequests::give_lines(const Call& call, const TappedFile& file) {
  const std::optional<int> bits = lines_of(file.fd());
  if (!bits) return outcome::Refuse{errno};
  tell_signals(*bits, false);
  return call.write_as(call.argument(2), *bits) ? Outcome(outcome::Answer{0})
                                                : Outcome(outcome::Refuse{EFAULT});
}

Outcome TapRequests::drive_lines(const Call& call, const TappedFile& file, std::uint32_t request) {
  const std::optional<int> bits = call.read_as<int>(call.argument(2));
  if (!bits) return outcome::Refuse{EFAULT};
  if (::ioctl(file.fd(), request, &*bits) != 0) return outcome::Refuse{errno};
  const int now = request == TIOCMBIS ? bits_ | *bits : request == TIOCMBIC ? bits_ & ~*bits : *bits;
  for (const auto& [name, bit] :
       {std::pair{LineSignal::Name::dtr, TIOCM_DTR}, {LineSignal::Name::rts, TIOCM_RTS}}) {
    if (((bits_ ^ now) & bit) != 0) line_->driver_did(LineSignal{name, (now & bit) != 0});
  }
  bits_ = (bits_ & ~kDriven) | (now & kDriven);
  return outcome::Answer{0};
}

void TapRequests::tell_signals(int bits, bool all) {
  for (const auto& [name, bit] : {std::pair{LineSignal::Name::cts, TIOCM_CTS},
                                  {LineSignal::Name::dsr, TIOCM_DSR},
                                  {LineSignal::Name::cd, TIOCM_CD},
                                  {LineSignal::Name::ri, TIOCM_RI}}) {
    if (all || ((bits_ ^ bits) & bit) != 0) line_->device_did(LineSignal{name, (bits & bit) != 0});
  }
  bits_ = bits;
}

CallPart::Decision TapRequests::drain(Supervisor& supervisor, const Call& call,
                                      const std::shared_ptr<TappedFile>& file) {
  const std::function<void()> over = line_->drains();
  const std::shared_ptr<KeptCall> kept = supervisor.keep(call);
  const std::weak_ptr weak(kept);
  const auto end = [this, weak, file, over](Outcome outcome) {
    over();
    finish(weak, *file, std::move(outcome));
  };
  kept->on_gone([end] { end(outcome::Refuse{EINTR}); });
  when_sent(weak, file, [end] { end(outcome::Pass{}); });
  return CallPart::Kept{};
}

// As send_break() of the kernel's tty_io.c, which waits in the call.
CallPart::Decision TapRequests::send_break(Supervisor& supervisor, const Call& call,
                                           const std::shared_ptr<TappedFile>& file, Nanos length) {
  const std::weak_ptr kept(supervisor.keep_until_signal(call));
  when_sent(kept, file, [this, kept, file, length] { begin_break(kept, file, length); });
  return CallPart::Kept{};
}

void TapRequests::begin_break(const std::weak_ptr<KeptCall>& kept, const std::shared_ptr<TappedFile>& file,
                              Nanos length) {
  const auto waiting = kept.lock();
  if (!waiting) return;
  if (std::holds_alternative<outcome::Refuse>(set_break(*file, true)))
    return finish(kept, *file, outcome::Pass{});  // what that means differs from kernel to kernel
  const auto end = [this, kept, file](Outcome outcome) {
    set_break(*file, false);
    finish(kept, *file, std::move(outcome));
  };
  waiting->on_gone([end] { end(outcome::Refuse{EINTR}); });
  waiting->call_after(length, [end] { end(outcome::Answer{0}); });
}

void TapRequests::finish(const std::weak_ptr<KeptCall>& kept, TappedFile& file, Outcome outcome) {
  const auto waiting = kept.lock();
  if (!waiting || waiting->over()) return;
  files_->let_go(waiting->call(), file);
  waiting->finish(std::move(outcome));
}

}  // namespace porttape
