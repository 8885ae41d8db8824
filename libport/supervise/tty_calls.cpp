#include "libport/supervise/tty_calls.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <utility>

#include "libport/loop/loop.hpp"
#include "libport/supervise/caller_rights.hpp"
#include "libport/supervise/event_requests.hpp"
#include "libport/supervise/settings_form.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {
namespace {

constexpr std::int64_t kMostTenths = 600;
constexpr Nanos kTenth = std::chrono::milliseconds(100);
constexpr tcflag_t kHidden = CSIZE | PARENB | PARODD | CMSPAR | CLOCAL;

constexpr std::array<std::uint32_t, 26> kRequests{
    TCGETS,   TCSETS,   TCSETSW,    TCSETSF,     TCGETA,      TCSETA,      TCSETAW,    TCSETAF,   TCGETS2,
    TCSETS2,  TCSETSW2, TCSETSF2,   TCSBRK,      TCSBRKP,     TIOCSBRK,    TIOCCBRK,   TIOCMGET,  TIOCMSET,
    TIOCMBIS, TIOCMBIC, TIOCMIWAIT, TIOCGICOUNT, TIOCGSERIAL, TIOCSSERIAL, TIOCGRS485, TIOCSRS485};

void put_flags(const SettingsForm& form, std::byte* settings, tcflag_t flags) {
  std::memcpy(settings + form.flags_at, &flags, form.flags_size);
}

void clear_ignbrk(std::byte* settings) {
  unsigned short low = 0;  // c_iflag comes first in each form
  std::memcpy(&low, settings, sizeof(low));
  low = static_cast<unsigned short>(low & ~static_cast<unsigned>(IGNBRK));
  std::memcpy(settings, &low, sizeof(low));
}

bool gives_settings(std::uint32_t request) {
  return request == TCGETS || request == TCGETS2 || request == TCGETA;
}

bool makes_settings(std::uint32_t request) {
  return request == TCSETS || request == TCSETS2 || request == TCSETA;
}

bool makes_settings_when_sent(std::uint32_t request) {
  return request == TCSETSW || request == TCSETSW2 || request == TCSETAW || request == TCSETSF ||
         request == TCSETSF2 || request == TCSETAF;
}

tcflag_t hidden_of(const LineSettings& settings) {
  constexpr std::array<tcflag_t, 4> sizes{CS5, CS6, CS7, CS8};
  tcflag_t flags = sizes.at(std::clamp(settings.data_bits, 5U, 8U) - 5);
  switch (settings.parity) {
    case Parity::none:
      return flags;
    case Parity::even:
      return flags | PARENB;
    case Parity::odd:
      return flags | PARENB | PARODD;
    case Parity::mark:
      return flags | PARENB | PARODD | CMSPAR;
    case Parity::space:
      return flags | PARENB | CMSPAR;
  }
  return flags;
}

Outcome done_well() { return outcome::Answer{0}; }
Outcome bad_address() { return outcome::Refuse{EFAULT}; }

}  // namespace

TtyCalls::TtyCalls(SupervisedLine& line, const LineDefaults& defaults, Tell tell)
    : line_(&line), model_(defaults), tells_lines_(defaults != LineDefaults()), tell_(std::move(tell)) {
  line_->supervise(this);
}

TtyCalls::~TtyCalls() {
  if (line_ != nullptr) line_->supervise(nullptr);
}

std::vector<CallTrap> TtyCalls::traps() const {
  CallTrap trap{.number = SYS_ioctl, .requests = {kRequests.begin(), kRequests.end()}};
  for (const EventRequest& each : kEventRequests) trap.requests.push_back(each.request);
  return {trap};
}

CallPart::Decision TtyCalls::decide(Supervisor& supervisor, const Call& call) {
  if (line_ == nullptr || call.number() != SYS_ioctl) return NotMine{};
  const auto request = static_cast<std::uint32_t>(call.argument(1));
  const EventRequest* const event = event_request(request);
  if (event == nullptr && std::ranges::find(kRequests, request) == kRequests.end()) return NotMine{};
  const std::optional<TtyDevice> device = line_->line_device();
  if (!device) return NotMine{};
  const std::optional<TtyDevice> asked = call.device_of(static_cast<int>(call.argument(0)));
  if (!asked && tell_ && call.is_closed()) {
    tell_(
        "a program that lets nobody look into its memory asks something of a tty: if that is its port, it "
        "gets "
        "what a plain pty gives; run porttape as root, or the program from a file that its user may read");
    tell_ = nullptr;
  }
  if (!asked || !asked->is(*device)) return NotMine{};
  if (gives_settings(request)) return give_settings(call, request);
  if (makes_settings(request) || makes_settings_when_sent(request))
    return decide_settings(supervisor, call, request);
  // What was written before is on its way, and not to be dropped.
  if (event != nullptr)
    return behind_writes(supervisor, call,
                         [this, event](const Call& waiting, SettingsOrder) { return make(*event, waiting); });
  switch (request) {
    case TCSBRK:
    case TCSBRKP:
    case TIOCSBRK:
    case TIOCCBRK:
      return decide_break(supervisor, call, request);
    default:
      return decide_signals(supervisor, call, request);
  }
}

CallPart::Decision TtyCalls::decide_signals(Supervisor& supervisor, const Call& call, std::uint32_t request) {
  switch (request) {
    case TIOCMGET:
      if (!open_) (void)line_->catch_up();  // the open is not known yet, which raises DTR and RTS
      return give_lines(call);
    case TIOCMSET:
    case TIOCMBIS:
    case TIOCMBIC:
      return behind_writes(supervisor, call, [this, request](const Call& waiting, SettingsOrder) {
        return drive_lines(waiting, request);
      });
    case TIOCMIWAIT:
      return wait_for_input(supervisor, call);
    case TIOCGICOUNT:
      return give_counters(call);
    case TIOCGSERIAL:
      return give_serial(supervisor, call);
    case TIOCSSERIAL:
      return make_serial(supervisor, call);
    case TIOCGRS485:
      return give_rs485(supervisor, call);
    case TIOCSRS485:
      return make_rs485(supervisor, call);
    default:
      return NotMine{};
  }
}

// As soon as the device takes what the driver has written before, but not for ever.
void TtyCalls::catch_up(const std::shared_ptr<KeptCall>& kept, Patience patience, const Step& step) {
  if (line_ == nullptr || line_->catch_up()) return step(SettingsOrder::exact);
  const Instant now = kept->now();
  const std::uint64_t before = std::exchange(patience.passed_on, line_->passed_on());
  if (patience.passed_on != before) patience.wait.more_given(now, 0);
  if (!patience.wait.goes_on(now, std::nullopt)) return step(SettingsOrder::sampled);
  kept->call_after(kCatchUpLook, [this, weak = std::weak_ptr(kept), patience, step] {
    if (const auto waiting = weak.lock()) catch_up(waiting, patience, step);
  });
}

// `then` has its place behind all that the driver has written.
CallPart::Decision TtyCalls::behind_writes(Supervisor& supervisor, const Call& call, const Then& then) {
  if (line_->catch_up()) return then(call, SettingsOrder::exact);
  const std::shared_ptr<KeptCall> kept = supervisor.keep(call);
  catch_up(kept, {EndWait(kept->now(), kCatchUpLimit)},
           [weak = std::weak_ptr(kept), then](SettingsOrder order) {
             if (const auto waiting = weak.lock()) waiting->finish(then(waiting->call(), order));
           });
  return Kept{};
}

// And once that has left the device.
void TtyCalls::when_sent(const std::shared_ptr<KeptCall>& kept, const KeptStep& step) {
  catch_up(kept, {EndWait(kept->now(), kCatchUpLimit)},
           [this, weak = std::weak_ptr(kept), step](SettingsOrder order) {
             const auto sent = [weak, step, order] {
               if (const auto waiting = weak.lock(); waiting && !waiting->over()) step(waiting, order);
             };
             if (line_ == nullptr) return sent();
             line_->wait_until_sent(sent);
           });
}

CallPart::Decision TtyCalls::behind_sent(const std::shared_ptr<KeptCall>& kept, const Then& then) {
  when_sent(kept, [then](const std::shared_ptr<KeptCall>& waiting, SettingsOrder order) {
    waiting->finish(then(waiting->call(), order));
  });
  return Kept{};
}

CallPart::Decision TtyCalls::decide_settings(Supervisor& supervisor, const Call& call,
                                             std::uint32_t request) {
  const auto make = [this, request](const Call& waiting, SettingsOrder order) {
    return make_settings(waiting, request, order);
  };
  return makes_settings(request) ? behind_writes(supervisor, call, make)
                                 : behind_sent(supervisor.keep(call), make);
}

Outcome TtyCalls::give_settings(const Call& call, std::uint32_t request) const {
  const SettingsForm form = form_of(request);
  std::array<std::byte, sizeof(termios2)> settings{};
  if (::ioctl(line_->line_fd(), request, settings.data()) != 0) return outcome::Pass{};
  put_flags(form, settings.data(), (flags_in(form, settings.data()) & ~kHidden) | hidden_);
  // A pty of ours is not quite as a serial line is opened (make_pty_raw()).
  if (as_opened_) clear_ignbrk(settings.data());
  return call.write(call.argument(2), std::span(settings).first(form.size)) ? done_well() : bad_address();
}

Outcome TtyCalls::make_settings(const Call& call, std::uint32_t request, SettingsOrder order) {
  if (line_ == nullptr) return outcome::Pass{};
  const SettingsForm form = form_of(request);
  std::array<std::byte, sizeof(termios2)> settings{};
  if (!call.read(call.argument(2), std::span(settings).first(form.size))) return bad_address();
  if (::ioctl(line_->line_fd(), request, settings.data()) != 0) return outcome::Refuse{errno};
  hidden_ = flags_in(form, settings.data()) & kHidden;
  as_opened_ = false;
  if (flushes_input(request)) line_->peer_did(line::Flush{FlushQueue::in});
  const LineSettings made = settings_now();
  // The rate 0 lowers DTR and RTS on the device by itself, another one raises them again.
  if (std::exchange(hung_up_, made.baud == 0) != hung_up_) hung_up_ ? model_.closed() : model_.opened();
  line_->peer_did(line::Settings{SeenSettings::of(made), order});
  look_at_inputs();
  return done_well();
}

LineSettings TtyCalls::settings_now() const {
  LineSettings settings;
  if (const Result<ShownSettings> shown = shown_settings(line_->line_fd()))
    settings = shown->settings.over(settings);
  settings.data_bits = data_bits_of(hidden_);
  settings.parity = parity_of(hidden_);
  settings.baud = uart_.rate_of(settings.baud);
  return settings;
}

// Done here, at its place; by the kernel where its descriptor is not to be had.
Outcome TtyCalls::make(const EventRequest& request, const Call& call) {
  const auto argument = static_cast<int>(call.argument(2));
  const std::optional<LineEvent> event = request.event(argument);
  if (!request.pty_does_it && !event) return outcome::Refuse{EINVAL};
  const UniqueFd tty = request.pty_does_it ? call.duplicate(static_cast<int>(call.argument(0))) : UniqueFd();
  if (tty && ::ioctl(tty.get(), request.request, argument) != 0) return outcome::Refuse{errno};
  if (line_ != nullptr && event) line_->peer_did(*event);
  return tty || !request.pty_does_it ? done_well() : outcome::Pass{};
}

Outcome TtyCalls::give_lines(const Call& call) const {
  return call.write_as(call.argument(2), model_.bits()) ? done_well() : bad_address();
}

Outcome TtyCalls::drive_lines(const Call& call, std::uint32_t request) {
  const std::optional<int> bits = call.read_as<int>(call.argument(2));
  if (!bits) return bad_address();
  for (const auto& [name, bit] :
       {std::pair{LineSignal::Name::dtr, TIOCM_DTR}, {LineSignal::Name::rts, TIOCM_RTS}}) {
    const bool named = (*bits & bit) != 0;
    if (request == TIOCMSET) {
      drive(name, named);
    } else if (named) {
      drive(name, request == TIOCMBIS);
    }
  }
  look_at_inputs();
  return done_well();
}

void TtyCalls::drive(LineSignal::Name name, bool on) {
  if (model_.drive(name, on)) signalled({name, on});
}

void TtyCalls::signalled(const LineSignal& signal) {
  if (line_ != nullptr) line_->peer_did(signal);
}

CallPart::Decision TtyCalls::wait_for_input(Supervisor& supervisor, const Call& call) {
  std::erase_if(input_waits_, [](const InputWait& wait) { return wait.call->over(); });
  input_waits_.push_back({supervisor.keep(call), static_cast<int>(call.argument(2)), model_.counters()});
  return Kept{};
}

// What the user wants the driver to see where the device has no lines is told as the device's.
void TtyCalls::tell_inputs() {
  if (!tells_lines_ || line_ == nullptr || !open_) return;
  const int bits = model_.bits();
  const int changed = told_inputs_ ? bits ^ *told_inputs_ : ~0;
  told_inputs_ = bits;
  for (const auto& [name, bit] : {std::pair{LineSignal::Name::cts, TIOCM_CTS},
                                  {LineSignal::Name::dsr, TIOCM_DSR},
                                  {LineSignal::Name::cd, TIOCM_CD},
                                  {LineSignal::Name::ri, TIOCM_RI}}) {
    if ((changed & bit) != 0) line_->peer_did(LineSignal{name, (bits & bit) != 0});
  }
}

void TtyCalls::look_at_inputs() {
  tell_inputs();
  const LineModel::Counters now = model_.counters();
  for (const InputWait& wait : input_waits_) {
    const bool changed = ((wait.mask & TIOCM_CTS) != 0 && wait.since.cts != now.cts) ||
                         ((wait.mask & TIOCM_DSR) != 0 && wait.since.dsr != now.dsr) ||
                         ((wait.mask & TIOCM_CD) != 0 && wait.since.cd != now.cd) ||
                         ((wait.mask & TIOCM_RI) != 0 && wait.since.ri != now.ri);
    if (changed) wait.call->finish(done_well());
  }
  std::erase_if(input_waits_, [](const InputWait& wait) { return wait.call->over(); });
}

CallPart::Decision TtyCalls::decide_break(Supervisor& supervisor, const Call& call, std::uint32_t request) {
  const auto length = static_cast<std::int64_t>(call.argument(2));
  switch (request) {
    case TCSBRK:
      if (length == 0) return send_break(supervisor, call, kBreak);
      return behind_sent(supervisor.keep_until_signal(call),
                         [](const Call&, SettingsOrder) { return done_well(); });
    case TCSBRKP:
      return send_break(supervisor, call, length > 0 ? std::min(length, kMostTenths) * kTenth : kBreak);
    case TIOCSBRK:
      return begin_break(supervisor, call, [](KeptCall& waiting, int error) {
        waiting.finish(error == 0 ? done_well() : outcome::Refuse{error});
      });
    default:
      signalled({LineSignal::Name::brk, false});
      return done_well();
  }
}

// Once all has left that was written before. `then` gets to know what the device says; the break is over then
// where that is an error, or where the call was interrupted.
CallPart::Decision TtyCalls::begin_break(Supervisor& supervisor, const Call& call, const Begun& then) {
  when_sent(supervisor.keep_until_signal(call), [this, then](const std::shared_ptr<KeptCall>& waiting,
                                                             SettingsOrder) {
    const auto end = [this] { signalled({LineSignal::Name::brk, false}); };
    signalled({LineSignal::Name::brk, true});
    waiting->on_gone([weak = std::weak_ptr(waiting), end] {
      end();
      if (const auto interrupted = weak.lock()) interrupted->finish(outcome::Refuse{EINTR});
    });
    const auto told = [weak = std::weak_ptr(waiting), end, then](const std::optional<LineAnswer>& answer) {
      const auto kept = weak.lock();
      if (!kept || kept->over()) return;
      const int error = answer ? answer->error : 0;
      if (error != 0) end();
      then(*kept, error);
    };
    if (line_ == nullptr) return told(std::nullopt);
    line_->ask({LineRequest::Kind::last_break}, told);
  });
  return Kept{};
}

// As the kernel has it, a device that knows no breaks is no error.
CallPart::Decision TtyCalls::send_break(Supervisor& supervisor, const Call& call, Nanos length) {
  return begin_break(supervisor, call, [this, length](KeptCall& waiting, int error) {
    if (error != 0) return waiting.finish(error == EOPNOTSUPP ? done_well() : outcome::Refuse{error});
    waiting.call_after(length, [this, &waiting] {
      signalled({LineSignal::Name::brk, false});
      waiting.finish(done_well());
    });
  });
}

Outcome TtyCalls::give_counters(const Call& call) const {
  const LineModel::Counters& counted = model_.counters();
  serial_icounter_struct counters{};
  counters.cts = counted.cts;
  counters.dsr = counted.dsr;
  counters.rng = counted.ri;
  counters.dcd = counted.cd;
  counters.brk = counted.breaks;
  return call.write_as(call.argument(2), counters) ? done_well() : bad_address();
}

// What the driver wrote before goes first, and the open that is not known yet.
CallPart::Decision TtyCalls::ask(Supervisor& supervisor, const Call& call, const LineRequest& request,
                                 const Answered& then) {
  (void)line_->catch_up();
  ask_for(supervisor.keep(call), request, [then](KeptCall& waiting, const std::optional<LineAnswer>& answer) {
    waiting.finish(then(waiting.call(), answer));
  });
  return Kept{};
}

// An error of the device is the call's.
void TtyCalls::ask_for(const std::shared_ptr<KeptCall>& kept, const LineRequest& request, const Told& then) {
  if (line_ == nullptr) return then(*kept, std::nullopt);
  line_->ask(request, [weak = std::weak_ptr(kept), then](const std::optional<LineAnswer>& answer) {
    const auto waiting = weak.lock();
    if (!waiting || waiting->over()) return;
    if (answer && answer->error != 0) return waiting->finish(outcome::Refuse{answer->error});
    then(*waiting, answer);
  });
}

CallPart::Decision TtyCalls::give_serial(Supervisor& supervisor, const Call& call) {
  return ask(supervisor, call, {LineRequest::Kind::get_serial},
             [this](const Call& waiting, const std::optional<LineAnswer>& answer) {
               if (answer) uart_.show(answer->serial);
               return write_serial(waiting, waiting.argument(2), uart_.serial()) ? done_well()
                                                                                 : bad_address();
             });
}

CallPart::Decision TtyCalls::make_serial(Supervisor& supervisor, const Call& call) {
  const std::optional<serial_struct> wanted = read_serial(call, call.argument(2));
  if (!wanted) return bad_address();
  (void)line_->catch_up();
  const std::shared_ptr<KeptCall> kept = supervisor.keep(call);
  if (is_administrator(call.thread())) {
    set_serial(kept, *wanted);
    return Kept{};
  }
  // The device would look at our rights.
  ask_for(
      kept, {LineRequest::Kind::get_serial},
      [this, wanted, weak = std::weak_ptr(kept)](KeptCall& waiting, const std::optional<LineAnswer>& now) {
        const bool allowed = UartModel::may_anybody(now ? now->serial : uart_.serial(), *wanted);
        allowed ? set_serial(weak.lock(), *wanted) : waiting.finish(outcome::Refuse{EPERM});
      });
  return Kept{};
}

void TtyCalls::set_serial(const std::shared_ptr<KeptCall>& kept, const serial_struct& wanted) {
  ask_for(kept, {LineRequest::Kind::set_serial, wanted},
          [this, wanted](KeptCall& waiting, const std::optional<LineAnswer>&) {
            uart_.make(wanted);
            waiting.finish(done_well());
          });
}

CallPart::Decision TtyCalls::give_rs485(Supervisor& supervisor, const Call& call) {
  return ask(supervisor, call, {LineRequest::Kind::get_rs485},
             [this](const Call& waiting, const std::optional<LineAnswer>& answer) {
               if (answer) uart_.show(answer->rs485);
               return waiting.write_as(waiting.argument(2), uart_.rs485()) ? done_well() : bad_address();
             });
}

// The driver is given back what was taken.
CallPart::Decision TtyCalls::make_rs485(Supervisor& supervisor, const Call& call) {
  const auto wanted = call.read_as<serial_rs485>(call.argument(2));
  if (!wanted) return bad_address();
  return ask(supervisor, call, {LineRequest::Kind::set_rs485, {}, *wanted},
             [this, wanted](const Call& waiting, const std::optional<LineAnswer>& answer) {
               uart_.show(answer ? answer->rs485 : *wanted);
               return waiting.write_as(waiting.argument(2), uart_.rs485()) ? done_well() : bad_address();
             });
}

void TtyCalls::line_opened() {
  open_ = true;
  as_opened_ = true;
  hidden_ |= CLOCAL;
  hung_up_ = false;
  model_.opened();
  look_at_inputs();
}

void TtyCalls::line_closed() {
  open_ = false;
  told_inputs_.reset();
  model_.closed();
  for (const InputWait& wait : std::exchange(input_waits_, {})) wait.call->finish(outcome::Refuse{EIO});
}

void TtyCalls::line_gone() {
  line_closed();
  line_ = nullptr;
}

void TtyCalls::line_shows(const LineSettings& settings) {
  hidden_ = hidden_of(settings) | (hidden_ & CLOCAL);
}

void TtyCalls::line_signalled(const LineSignal& signal) {
  tells_lines_ = false;  // it has lines of its own
  model_.show(signal);
  look_at_inputs();
}

}  // namespace porttape
