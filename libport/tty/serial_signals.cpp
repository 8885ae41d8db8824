// The signals of SerialPort, its drains, and what is asked of its device.

#include <algorithm>
#include <cerrno>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/tty/serial_port.hpp"

namespace porttape {

void SerialPort::tell(const LineEvent& event) {
  if (const auto* signal = std::get_if<LineSignal>(&event)) {
    drive(*signal);
  } else if (const auto* drained = std::get_if<line::Drain>(&event)) {
    drain(drained->number);
  } else if (const auto* question = std::get_if<line::Ask>(&event)) {
    ask(*question);
  } else if (const auto* watch = std::get_if<line::WatchSignals>(&event)) {
    watch_signals(watch->on);
  }
}

void SerialPort::drive(const LineSignal& signal) {
  const bool ours = is_output(signal.name) || signal.name == LineSignal::Name::brk;
  if (ours && opened_) driven_[signal.name] = signal.on;
  if (line_ && ours) line_->changes.signal(signal);
}

// A device that is back stands as one that was just opened.
void SerialPort::drive_again() {
  for (const auto& [name, on] : driven_) {
    const bool stands = on == (name != LineSignal::Name::brk);
    if (!stands) line_->changes.signal({name, on});
  }
  for (const auto& [kind, request] : made_) line_->changes.ask(request, [](const auto&) {});
}

// The next driver finds the line as by an open.
void SerialPort::release_driven() {
  for (const auto& [name, on] : std::exchange(driven_, {})) {
    const bool home = name == LineSignal::Name::dtr   ? options_.dtr.value_or(true)
                      : name == LineSignal::Name::rts ? options_.rts.value_or(true)
                                                      : false;
    if (line_ && on != home) line_->changes.signal({name, home});
  }
}

void SerialPort::signal_made(const LineSignal& signal, int error_number) {
  if (error_number == 0) return;
  const bool is_break = signal.name == LineSignal::Name::brk;
  const bool is_no_line = error_number == ENOTTY || error_number == EINVAL;
  const bool has_none = is_no_line || error_number == EOPNOTSUPP;  // a USB modem that knows no breaks
  const std::string text =
      has_none ? fmt::format("{}: the device has no {}; what the driver does to them is ignored", name(),
                             is_break ? "breaks" : "modem lines")
      : error_number == ETIMEDOUT
          ? fmt::format("{}: a break is left out, since the device does not take the bytes before it", name())
          : fmt::format("{}: setting {}: {}; check the device", name(), name_of(signal.name),
                        errno_text(error_number));
  if (told_.insert(text).second)
    context_.log->log(is_no_line ? spdlog::level::info : spdlog::level::warn, "{}", text);
}

void SerialPort::drain(RequestNumber number) {
  if (!line_) return listener().told(line::Sent{number});
  line_->changes.drain([this, number, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) listener().told(line::Sent{number});
  });
}

void SerialPort::ask(const line::Ask& question) {
  if (!line_) return listener().told(line::Answer{question.number, LineAnswer{.error = EIO}});
  line_->changes.ask(question.request, [this, question, alive = std::weak_ptr<int>(alive_)](
                                           const std::optional<LineAnswer>& answer) {
    if (alive.expired()) return;
    const LineRequest& request = question.request;
    const bool makes =
        request.kind == LineRequest::Kind::set_serial || request.kind == LineRequest::Kind::set_rs485;
    if (makes && opened_ && answer && answer->error == 0) made_[request.kind] = request;
    listener().told(line::Answer{question.number, answer});
  });
}

void SerialPort::watch_signals(bool on) {
  if (std::exchange(signals_wanted_, on) == on || !line_) return;
  line_->modem.reset();
  line_->lines.reset();
  if (!on) return;
  // Before the line comes up, as at an open. Later it waits for nothing: the watch tells how they stand.
  if (!opened_) line_->lines = calls_->modem_lines(line_->fd.get());
  if (opened_ || line_->lines) watch_modem();
}

void SerialPort::watch_modem() {
  line_->modem = ModemWatch::start(*context_.loop, calls_, line_->fd.get(), line_->lines,
                                   [this](const LineSignal& signal) { signalled(signal); });
  if (!line_->modem)
    warn_once(fmt::format("{}: no thread is to be had to watch its modem lines, which are not told", name()));
}

// What has come by now came before, as far as that can be known.
void SerialPort::signalled(const LineSignal& signal) {
  if (const int bit = modem_bit(signal.name); bit != 0) {
    const int others = line_->lines.value_or(0) & ~bit;
    line_->lines = signal.on ? others | bit : others;
  }
  if (common_.reads) on_readable();
  if (line_ && up_) listener().told(signal);
}

// A break reads as a zero.
void SerialPort::look_for_break(ByteView data) {
  if (line_->modem && std::ranges::find(data, Byte{0}) != data.end()) line_->modem->look_soon();
}

// How they stand.
void SerialPort::tell_signals() {
  if (!line_ || !line_->lines) return;
  tell_modem_lines(std::nullopt, *line_->lines, [this](const LineSignal& signal) {
    if (line_ && up_) listener().told(signal);
  });
}

}  // namespace porttape
