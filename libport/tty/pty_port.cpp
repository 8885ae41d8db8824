#include "libport/tty/pty_port.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/loop/sampler.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {
namespace {

constexpr Nanos kUnreadPoll =
    std::chrono::milliseconds(2);  // no event tells that a driver has read everything

// Where that cannot be seen, it has this long to read and close.
constexpr Nanos kUnknownLimit = std::chrono::seconds(5);

// A driver that is not read and has closed: how long what it left is kept while the device takes nothing, and
// how often it is looked whether another one has come.
constexpr Nanos kLookUnread = std::chrono::milliseconds(250);
constexpr Nanos kRestLimit = std::chrono::seconds(10);

constexpr std::size_t kMostHeld = std::size_t{128} * 1024;

// A pty that could not be made (too many open files, say) is tried again.
constexpr Nanos kRenewAgain = std::chrono::milliseconds(500);
constexpr Nanos kRenewSeldom = std::chrono::seconds(5);

}  // namespace

PtyPort::Line::Line(PtyPort& port, Pty made)
    : pty(std::move(made)),
      device(tty_device_at(pty.slave_path())),
      settings(pty.master()),
      clocal_watch(port.supervisor_ != nullptr
                       ? nullptr
                       : port.context_.loop->urgent_events().watch(pty.master(), clear_clocal)),
      master_watch(
          *port.context_.loop, pty.master(), [&port] { port.on_readable(); }, [this] { outbox.flush(); },
          [&port] { port.look_unread(); }),
      // A write fails only when the driver is gone; the read side sees to that.
      outbox(
          pty.master(), Outbox::Kind::file, master_watch,
          [&port] {
            if (port.up_) port.listener().on_drained();
          },
          [&port](int, std::size_t lost) {
            port.listener().told(line::Dropped{lost, "they could not be sent"});
          }) {
  pty.on_events([&port] { port.on_event(); });
}

PtyPort::PtyPort(const PortContext& context, PtyOptions options)
    : context_(context),
      access_(options.access),
      names_(context, std::move(options.link), std::move(options.bind)),
      hang_up_timer_(*context.loop, [this] { on_hang_up_timer(); }),
      renew_timer_(*context.loop, [this] { renew_line(); }),
      renew_wait_(kRenewAgain, kRenewSeldom),
      unread_timer_(*context.loop, [this] { on_unread_timer(); }) {}

PtyPort::~PtyPort() {
  if (supervisor_ != nullptr) supervisor_->line_gone();
  if (peer_) context_.loop->sampler().remove(this);
}

Result<void> PtyPort::prepare() {
  if (Result<void> made = make_line(); !made) return made;
  Result<void> named = names_.publish(line_->pty.slave_path());
  if (!named) line_.reset();
  return named;
}

Result<void> PtyPort::make_line() {
  Result<Pty> pty = Pty::create(context_.loop->file_events(), access_);
  if (!pty) return pty.error();
  auto line = std::make_unique<Line>(*this, std::move(*pty));
  drop_line();
  line_ = std::move(line);
  show_home();
  if (const std::string trouble = context_.loop->file_events().take_trouble(); !trouble.empty())
    context_.log->warn("{}", trouble);
  return {};
}

// One of the old line's callbacks may be running: it goes on the next turn of the loop.
void PtyPort::drop_line() {
  if (!line_) return;
  line_->master_watch.stop();
  line_->pty.on_events({});
  context_.loop->post([old = std::shared_ptr<Line>(std::move(line_))] {});
}

void PtyPort::replace_line() {
  drop_held();
  if (supervisor_ != nullptr && peer_) supervisor_->line_closed();
  openers_ = 0;
  events_lost_ = false;
  peer_ = false;
  context_.loop->sampler().remove(this);
  drop_line();
  if (make_line()) return line_renewed();
  // Where descriptors are short, the old line's are what the new one can have: they are free on the next
  // turn.
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired() && !line_) renew_line();
  });
}

void PtyPort::renew_line() {
  if (Result<void> made = make_line(); !made) {
    if (renew_wait_.is_first())
      context_.log->error("{}; {} is dead until that is mended", made.error().message, name());
    renew_timer_.set_after(renew_wait_.next());
    return;
  }
  line_renewed();
}

void PtyPort::line_renewed() {
  if (!renew_wait_.is_first()) context_.log->info("{}: there is a pty for it again", name());
  renew_wait_.reset();
  names_.retarget(line_->pty.slave_path());
}

Result<void> PtyPort::apply(const LineSettings& settings) {
  if (!peer_) {
    if (home_ == settings) return {};  // shown already; a driver may be there that nothing has told of
    home_ = settings;
  }
  if (supervisor_ != nullptr) supervisor_->line_shows(settings);
  return line_ ? show(settings) : Result<void>();
}

Result<void> PtyPort::show(const LineSettings& settings) {
  Result<void> shown;
  line_->pty.without_visit([&] { shown = line_->settings.show(settings); });
  return shown;
}

void PtyPort::show_home() {
  if (!home_) return line_->settings.take_as_known();
  if (Result<void> shown = show(*home_); !shown) context_.log->warn("{}: {}", name(), shown.error().message);
}

void PtyPort::look_at_settings(bool moved_on) {
  if (!up_ || !line_ || supervisor_ != nullptr) return;
  if (const auto seen = line_->settings.look(moved_on))
    tell_settings(*seen, line_->pty.has_input() ? SettingsOrder::sampled : SettingsOrder::exact);
}

void PtyPort::tell_settings(const SeenSettings& seen, SettingsOrder order) {
  watch_settings();  // where one change is, another may follow
  listener().told(line::Settings{seen, order});
}

void PtyPort::watch_settings() {
  if (supervisor_ != nullptr) return;
  context_.loop->sampler().add(this, [this] { look_at_settings(false); });
}

void PtyPort::open() {
  accepting_ = true;
  if (peer_) {
    watch_reading();
    deliver_held_soon();
    set_up(true);
  } else if (line_) {
    on_event();
  }
}

// Whether a peer is there, or came and went, that no event told of.
void PtyPort::look() {
  if (peer_ || !line_) return;
  const bool visited = line_->pty.take_visit();
  if (line_->pty.exact() && !events_lost_) return;
  if (visited || line_->pty.occupied()) return peer_arrived(std::nullopt);
  events_lost_ = false;
}

void PtyPort::close() {
  accepting_ = false;
  if (!line_) {
    up_ = false;
    return;
  }
  if (std::exchange(up_, false)) tell_left(line_->outbox.pending(), line_->pty.unread());
  drop_unsent();
  watch_reading();
}

// Between close() and open() a peer's bytes wait for the next session.
void PtyPort::watch_reading() {
  line_->master_watch.watch_readable(may_deliver());
  line_->master_watch.watch_hang_up(peer_ && accepting_ && !reading_);
  rest_wait_.reset();
  unread_timer_.cancel();
}

// Without reading, its end is not seen behind the bytes that it left.
void PtyPort::look_unread() {
  if (!peer_ || !line_ || reading_) return;
  const Instant now = context_.loop->now();
  line_->master_watch.watch_hang_up(false);  // it would be told again and again
  if (line_->pty.open_now()) {  // another one has come, or a flush is to be read: it looks the same
    rest_wait_.reset();
    return unread_timer_.set_after(kLookUnread);
  }
  if (!rest_wait_) rest_wait_.emplace(now, kRestLimit);
  if (left_bytes() && listener().wants_rest() && rest_wait_->goes_on(now, listener().unread()))
    return unread_timer_.set_after(kLookUnread);
  drop_rest("the driver had closed before the device could take them");
  master_ended();
}

void PtyPort::on_unread_timer() {
  if (rest_wait_) {
    look_unread();
  } else if (line_) {
    watch_reading();
  }
}

// What it has written and nobody has read.
void PtyPort::drop_rest(std::string_view why) {
  drop_held();
  std::uint64_t bytes = 0;
  const std::span<Byte> buffer = context_.loop->read_buffer().first(kReadSize);
  for (ssize_t size = 1; size > 0 && bytes < kMostHeld;) {
    size = ::read(line_->pty.master(), buffer.data(), buffer.size());
    if (size > 1 && buffer.front() == TIOCPKT_DATA) bytes += static_cast<std::uint64_t>(size - 1);
  }
  if (bytes > 0) listener().told(line::Dropped{bytes, why});
}

// What a driver that goes has not read. `in_kernel`: none where that cannot be seen.
void PtyPort::tell_left(std::size_t unsent, std::optional<std::size_t> in_kernel) {
  line::LeftUnread left;
  if (in_kernel || unsent > 0) left.bytes = unsent + in_kernel.value_or(0);
  listener().told(left);
}

void PtyPort::drop_unsent() {
  const std::size_t bytes = line_->outbox.pending();
  line_->outbox.discard();
  if (bytes > 0) listener().told(line::Dropped{bytes, "the driver did not take them"});
}

void PtyPort::drop_held() {
  if (held_.size() > 1 && held_.front() == TIOCPKT_DATA)
    listener().told(line::Dropped{held_.size() - 1, "the line ended before they could be passed on"});
  held_.clear();
}

void PtyPort::write(ByteView data) {
  if (peer_ && line_) {
    line_->outbox.write(data);
    context_.loop->sampler().touch(this);
  } else {
    listener().told(line::Dropped{data.size(), "no driver had it open"});
  }
}

std::optional<std::size_t> PtyPort::unread_by_peer() const {
  if (!peer_ || !line_) return 0;
  // Once the line is over, all of it is counted, which no driver may read any more then.
  const std::optional<std::size_t> unread =
      accepting_ ? line_->pty.unread() : line_->pty.read_away(Pty::LineIs::over);
  return unread ? std::optional(line_->outbox.pending() + *unread) : std::nullopt;
}

void PtyPort::set_reading(bool on) {
  reading_ = on;
  if (!line_) return;
  watch_reading();
  deliver_held_soon();
}

void PtyPort::set_up(bool up, LineDown::Reason reason) {
  if (up_ == up || (up && !accepting_)) return;
  up_ = up;
  if (!up) return listener().on_down({.reason = reason, .error = {}});
  listener().on_up();
  for (const LineEvent& event : early_.take_all()) peer_did(event);
}

void PtyPort::tell_opened() {
  early_.clear();
  if (supervisor_ != nullptr) supervisor_->line_opened();
}

void PtyPort::peer_arrived(Openers openers) {
  peer_ = true;
  openers_ = openers;
  context_.log->debug("{}: opened", name());
  tell_opened();
  watch_reading();
  watch_settings();
  set_up(true);
}

// Nobody has it open and everything is read. Events up to the last close belong to the session that ends,
// later ones to the next.
void PtyPort::master_ended() {
  const std::vector<Pty::Event> events = line_->pty.take_events();
  auto next = events.begin();
  while (next != events.end() && openers_ != 0) count(*next++);
  events_lost_ = events_lost_ || openers_ != 0;
  const Line* const line = line_.get();
  peer_left();
  if (line_.get() == line) handle_events({next, events.end()});
  if (line_) handle_events(line_->pty.take_events());
  // Inotify makes one event of two opens at the same moment: a driver's, and ours of settle().
  if (!peer_ && line_) {
    const bool exact = line_->pty.exact();
    const bool visited = line_->pty.take_visit() && !exact;
    if (visited || line_->pty.occupied()) peer_arrived(exact ? Openers(1) : std::nullopt);
  }
  events_lost_ = false;
}

void PtyPort::peer_left() {
  look_at_settings(true);
  if (!peer_ || !line_) return;  // hung up from within
  peer_ = false;
  openers_ = 0;
  hang_up_timer_.cancel();
  context_.loop->sampler().remove(this);
  context_.log->debug("{}: closed", name());
  if (supervisor_ != nullptr) {
    supervisor_->line_closed();
    if (home_) supervisor_->line_shows(*home_);
  }
  line_->master_watch.watch_readable(false);
  const std::size_t unsent = line_->outbox.pending();
  drop_unsent();
  if (Result<void> settled = line_->pty.settle(home_); settled) {
    line_->settings.assume(home_);
    tell_left(unsent, line_->pty.left_unread());
  } else {
    tell_left(unsent, std::nullopt);
    if (Result<void> made = make_line(); made) {
      context_.log->log(std::exchange(told_replaced_, true) ? spdlog::level::debug : spdlog::level::info,
                        "{}; a new pty takes its place", settled.error().message);
      names_.retarget(line_->pty.slave_path());
    } else {
      context_.log->warn("{}; what the last driver did not read may reach the next", settled.error().message);
    }
  }
  set_up(false);
}

// What is unread counts as the new session's. If the last one left a tail, its bytes come late, but they
// come; the other way round the new session's request would go to a device that is closed before it has
// answered.
void PtyPort::peer_reopened() {
  context_.log->debug("{}: closed and opened again", name());
  const std::size_t unsent = line_->outbox.pending();
  drop_unsent();
  // And what the last one left unread, as a close does; nothing has come for the new one yet.
  tell_left(unsent, line_->pty.read_away(Pty::LineIs::next_ones));
  hang_up_timer_.cancel();
  if (supervisor_ != nullptr) supervisor_->line_closed();
  set_up(false);
  tell_opened();
  line_->settings.assume(home_);
  watch_settings();
  set_up(true);
}

void PtyPort::on_event() {
  if (!line_) return;
  handle_events(line_->pty.take_events());
  look();
}

// Makes sessions of what programs did since the last look.
void PtyPort::handle_events(const std::vector<Pty::Event>& events) {
  const Line* const line = line_.get();
  for (const Pty::Event event : events) {
    if (line_.get() != line) return;  // hung up from within: these were the old line's
    handle_event(event);
  }
}

void PtyPort::handle_event(Pty::Event event) {
  const bool again = openers_ == 0;
  const bool opened = event == Pty::Event::opened;
  if (opened && !peer_) openers_ = 0;
  count(event);
  if (!opened) return;
  if (!peer_) {
    peer_arrived(openers_);
  } else if (again) {
    peer_reopened();
  } else if (openers_) {
    context_.log->info("{}: a second program has opened it", name());
  }
}

void PtyPort::count(Pty::Event event) {
  switch (event) {
    case Pty::Event::opened:
      openers_ = openers_ && line_->pty.exact() ? Openers(*openers_ + 1) : std::nullopt;
      break;
    case Pty::Event::closed:
      if (openers_ && *openers_ > 0) --*openers_;
      break;
    case Pty::Event::unknown:
      if (peer_) openers_.reset();
      events_lost_ = true;
      break;
    case Pty::Event::changed:
      break;
  }
}

void PtyPort::on_readable() {
  if (!line_) return;
  // More than one read only when the first was full: an extra read for EAGAIN would cost each short exchange.
  deliver_held();
  while (may_deliver() && read_once()) {
  }
}

bool PtyPort::read_once() {
  const ssize_t size = read_packet();
  if (size > 0) return static_cast<std::size_t>(size) == kReadSize;
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return false;
  master_ended();
  return false;
}

// As ::read(), what came of it passed on. The settings are looked at just before and just after.
ssize_t PtyPort::read_packet() {
  const std::span<Byte> buffer = context_.loop->read_buffer().first(kReadSize);
  const Line* const line = line_.get();
  look_at_settings(false);
  if (line_.get() != line) {  // hung up from within
    errno = EAGAIN;
    return -1;
  }
  const ssize_t size = ::read(line_->pty.master(), buffer.data(), buffer.size());
  if (size <= 0) return size;
  const std::optional<SeenSettings> changed =
      up_ && supervisor_ == nullptr ? line_->settings.look(true) : std::nullopt;
  const bool has_data = size > 1 && buffer.front() == TIOCPKT_DATA;
  context_.loop->sampler().touch(this);
  take_packet(ByteView(buffer).first(static_cast<std::size_t>(size)));
  if (changed && up_) tell_settings(*changed, has_data ? SettingsOrder::sampled : SettingsOrder::exact);
  return size;
}

// A reopen may have come before these bytes without having woken us yet. A session that has just begun is not
// read before its device is up: then they are kept.
void PtyPort::take_packet(ByteView packet) {
  const std::vector<Pty::Event> events = line_->pty.take_events();
  if (events.empty()) return handle_packet(packet);
  held_.assign(packet.begin(), packet.end());
  handle_events(events);
  deliver_held();
}

void PtyPort::deliver_held() {
  if (!held_.empty() && may_deliver()) handle_packet(std::exchange(held_, {}));
}

// Not from within the call that allows it.
void PtyPort::deliver_held_soon() {
  if (held_.empty() || !may_deliver()) return;
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) deliver_held();
  });
}

void PtyPort::handle_packet(ByteView packet) {
  const Byte status = packet.front();
  if (status == TIOCPKT_DATA) {
    passed_on_ += packet.size() - 1;
    if (packet.size() > 1) listener().on_data(packet.subspan(1));
    return;
  }
  if (supervisor_ != nullptr) return;  // which has told it already
  const bool in = (status & TIOCPKT_FLUSHREAD) != 0;
  const bool out = (status & TIOCPKT_FLUSHWRITE) != 0;
  if (in || out) driver_flushed(in && out ? FlushQueue::both : in ? FlushQueue::in : FlushQueue::out);
}

void PtyPort::driver_flushed(FlushQueue queue) {
  if (queue != FlushQueue::out) {
    const bool was_congested = congested();
    line_->outbox.discard();
    line_->pty.drop_backlog(was_congested);
    if (was_congested && up_) listener().on_drained();
  }
  listener().told(line::Flush{queue});
}

void PtyPort::supervise(LineSupervisor* supervisor) {
  supervisor_ = supervisor;
  if (supervisor == nullptr) return;
  context_.loop->sampler().remove(this);
  if (line_) line_->clocal_watch.reset();
  if (home_) supervisor->line_shows(*home_);
  if (peer_) supervisor->line_opened();
}

bool PtyPort::catch_up() {
  on_event();
  read_pending();
  return !line_ || (held_.empty() && !line_->pty.has_input());
}

void PtyPort::peer_did(const LineEvent& event) {
  if (const auto* flush = std::get_if<line::Flush>(&event)) {
    if (line_) driver_flushed(flush->queue);
    return;
  }
  const bool sets = std::holds_alternative<line::Settings>(event);
  if (line_ && sets) line_->settings.take_as_known();
  if (up_) return listener().told(event);
  if (!sets) early_.put(event);  // of settings the first look tells
}

void PtyPort::wait_until_sent(std::function<void()> done) {
  if (!up_) return done();
  listener().told(line::Drain{drains_.keep(std::move(done))});
}

void PtyPort::ask(const LineRequest& request, TakeAnswer done) {
  if (!up_) return done(std::nullopt);
  listener().told(line::Ask{questions_.keep(std::move(done)), request});
}

void PtyPort::tell(const LineEvent& event) {
  if (const auto* signal = std::get_if<LineSignal>(&event)) {
    if (supervisor_ != nullptr) supervisor_->line_signalled(*signal);
  } else if (const auto* sent = std::get_if<line::Sent>(&event)) {
    if (const auto done = drains_.take(sent->number)) (*done)();
  } else if (const auto* answer = std::get_if<line::Answer>(&event)) {
    if (const auto done = questions_.take(answer->number)) (*done)(answer->answer);
  } else {
    Port::tell(event);
  }
}

void PtyPort::read_pending() {
  if (!peer_ && accepting_) on_event();  // one that has come and gone before anything told of it
  deliver_held();
  // What a pty can hold, so that a driver that goes on writing does not keep us.
  for (std::size_t left = kMostHeld; left > 0 && line_ && may_deliver();) {
    const ssize_t size = read_packet();
    if (size <= 0) break;
    left -= std::min(left, static_cast<std::size_t>(size));
  }
}

bool PtyPort::left_bytes() const {
  return peer_ && line_ && !line_->pty.open_now() && (!held_.empty() || line_->pty.occupied());
}

void PtyPort::finish() {
  drop_held();
  listener().on_complete(0);
}

void PtyPort::hang_up(bool after_reading) {
  if (!peer_) return;
  if (!after_reading) {
    context_.log->debug("{}: hung up", name());
    drop_rest("the line was hung up before they could be passed on");
    replace_line();
    context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
      if (!alive.expired()) set_up(false, LineDown::Reason::hung_up);
    });
    return;
  }
  unknown_since_.reset();
  hang_up_timer_.set_after(kUnreadPoll);
}

void PtyPort::on_hang_up_timer() {
  if (!peer_) return;
  const std::optional<std::size_t> unread = congested() ? 1 : line_->pty.unread();
  if (!unread) tell_waiting();
  if (unread == 0 || (!unread && context_.loop->now() - *unknown_since_ >= kUnknownLimit)) {
    tell_left(0, unread ? line_->pty.read_away(Pty::LineIs::over) : std::nullopt);
    hang_up(false);
  } else {
    hang_up_timer_.set_after(kUnreadPoll);
  }
}

void PtyPort::tell_waiting() {
  if (unknown_since_) return;
  unknown_since_ = context_.loop->now();
  context_.log->warn(
      "{}: whether the driver has read everything cannot be seen (it keeps the line to itself, TIOCEXCL, and "
      "this "
      "process is not root; or no descriptor is left); it has {} s to close",
      name(), std::chrono::duration_cast<std::chrono::seconds>(kUnknownLimit).count());
}

std::string PtyPort::name() const {
  const std::string path = place().path;
  return path.empty() ? "pty" : "pty:" + path;
}

PortPlace PtyPort::place() const {
  const std::string node = line_ ? line_->pty.slave_path() : std::string();
  PortPlace place = names_.place(node);
  place.node = node;
  return place;
}

}  // namespace porttape
