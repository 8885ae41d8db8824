#include "libport/formats/strace_format.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <memory>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/formats/byte_text.hpp"
#include "libport/formats/line_import.hpp"
#include "libport/formats/strace_line.hpp"
#include "libport/formats/strace_terminal.hpp"
#include "libport/formats/traced_files.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostPending = 64;

// A call's family; what is not in it is none of ours.
constexpr std::array<std::string_view, 4> kReads{"read", "readv", "pread64", "preadv"};
constexpr std::array<std::string_view, 4> kWrites{"write", "writev", "pwrite64", "pwritev"};
constexpr std::array<std::string_view, 3> kReceives{"recvfrom", "recvmsg", "recv"};
constexpr std::array<std::string_view, 3> kSends{"sendto", "sendmsg", "send"};
constexpr std::array<std::string_view, 4> kOpens{"open", "openat", "openat2", "creat"};
constexpr std::array<std::string_view, 4> kForks{"fork", "vfork", "clone", "clone3"};

template <std::size_t N>
bool is_one_of(std::string_view name, const std::array<std::string_view, N>& names) {
  return std::ranges::find(names, name) != names.end();
}

std::string text_of(const StraceString& string) { return std::string(as_text(string.bytes)); }

// Surely a line to a device, and not the controlling terminal.
bool is_line_path(std::string_view path) {
  for (const std::string_view begin : {"/dev/tty", "/dev/serial/", "/dev/pts/", "/dev/rfcomm", "/dev/cu"}) {
    if (path.starts_with(begin) && path != "/dev/tty" && path.size() > begin.size()) return true;
  }
  return false;
}

class StraceImport final : public LineImport {
 public:
  StraceImport(Evidence& from, ImportTape& to) : LineImport(from, to), wanted_(to.options().device) {
    to.keep_order();
  }

 private:
  Result<void> at_end() override {
    if (device_path_.empty()) return nothing_found();
    if (breaking_) {
      if (Result<void> ended = end_break(now_us_); !ended) return ended;
    }
    tell_problems();
    if (line().whole) end_at(time_of(now_us_));
    return {};
  }

  Result<void> take_line() override {
    const Evidence::Line& text = LineImport::line();
    if (text.text.empty()) return {};
    StraceLines::Line line = lines_.read(text.text);
    if (!line.understood) {
      tape().problem_of_line(text.number, "none of strace's; left out");
      return {};
    }
    if (line.end) {
      now_us_ = std::max(now_us_, last_begin_us_);
      files_.exit(line.end->thread);
      return look_for_close();
    }
    if (!line.call) return {};
    last_begin_us_ = line.call->begin_us;
    now_us_ = std::max({now_us_, line.call->begin_us, line.call->end_us.value_or(0)});
    if (breaking_ == line.call->thread) {
      if (Result<void> ended = end_break(line.call->begin_us); !ended) return ended;
    }
    return take_call(*line.call);
  }

  Result<void> take_call(const StraceCall& call) {
    const std::string_view name = call.name;
    if (is_one_of(name, kReads) || is_one_of(name, kReceives)) return take_read(call);
    const bool connecting = call.error == "EINPROGRESS" || call.error == "EINTR" || call.error == "EISCONN";
    if (name == "connect" && connecting) return take_connect(call);
    if (call.result.value_or(-1) < 0) return {};
    if (is_one_of(name, kWrites) || is_one_of(name, kSends)) return take_write(call);
    if (name == "ioctl") return take_ioctl(call);
    if (is_one_of(name, kOpens)) return take_open(call);
    if (name == "connect") return take_connect(call);
    if (is_one_of(name, kForks)) {
      files_.fork(call.thread, static_cast<std::uint32_t>(*call.result),
                  call.args.find("CLONE_FILES") != std::string::npos);
    } else if (name == "execve" || name == "execveat") {
      files_.exec(call.thread);
    } else {
      take_descriptors(call);
    }
    return look_for_close();
  }

  // close, dup and their like.
  void take_descriptors(const StraceCall& call) {
    const auto fd = strace_number(call.args);
    const auto result = static_cast<int>(*call.result);
    if (!fd) return;
    if (call.name == "close") return files_.close(call.thread, *fd);
    if (call.name == "close_range") {
      const auto last = whole_number<unsigned>(strace_argument(call.args, 1));
      if (last && call.args.find("CLOSE_RANGE_CLOEXEC") == std::string::npos)
        files_.close_range(call.thread, static_cast<unsigned>(*fd), *last);
      return;
    }
    if (call.name == "dup" || call.name == "dup2") return files_.copy(call.thread, *fd, result, false);
    const bool close_on_exec = call.args.find("CLOEXEC") != std::string::npos;
    if (call.name == "dup3") return files_.copy(call.thread, *fd, result, close_on_exec);
    if (call.name != "fcntl") return;
    const std::string_view command = strace_argument(call.args, 1);
    if (command.starts_with("F_DUPFD"))
      return files_.copy(call.thread, *fd, result, command.ends_with("CLOEXEC"));
    if (command == "F_SETFD") files_.set_close_on_exec(call.thread, *fd, close_on_exec);
  }

  Result<void> take_open(const StraceCall& call) {
    const auto strings = strace_strings(call.args);
    if (strings.empty()) return {};
    auto file = std::make_shared<TracedFile>();
    file->path = text_of(strings.front());
    file->opened_us = call.begin_us;
    files_.open(call.thread, static_cast<int>(*call.result), file,
                call.args.find("O_CLOEXEC") != std::string::npos);
    const std::string& known = wanted_ ? *wanted_ : device_path_;
    const bool is_it = known.empty() ? is_line_path(file->path) : file->path == known;
    if (is_it) return choose(file);
    file->may_be_device = known.empty() && file->path != "/dev/tty";
    return look_for_close();
  }

  // A socket is the device where it was asked for: HOST:PORT.
  Result<void> take_connect(const StraceCall& call) {
    if (!wanted_) return {};
    const auto strings = strace_strings(call.args);
    const std::size_t port_at = call.args.find("htons(");
    const auto fd = strace_number(call.args);
    if (strings.empty() || port_at == std::string::npos || !fd) return {};
    const auto port = strace_number(std::string_view(call.args).substr(port_at + 6));
    if (!port || fmt::format("{}:{}", text_of(strings.back()), *port) != *wanted_) return {};
    // Asked again how the connection is.
    if (const auto known = files_.find(call.thread, *fd); known && is_device(known)) return {};
    auto file = std::make_shared<TracedFile>();
    file->path = *wanted_;
    file->is_socket = true;
    file->opened_us = call.begin_us;
    files_.open(call.thread, *fd, file, false);
    return choose(file);
  }

  // The file of a call on a descriptor; null: none of those that matter.
  TracedFiles::File file_of(const StraceCall& call) {
    const auto fd = strace_number(call.args);
    if (!fd) return nullptr;
    TracedFiles::File file = files_.find(call.thread, *fd);
    if (file || !wanted_) return file;
    // It had it before; -y tells what it is.
    const std::size_t open = call.args.find('<');
    const std::size_t close = call.args.find('>');
    if (open == std::string::npos || close == std::string::npos || open > close) return nullptr;
    std::string_view shown = std::string_view(call.args).substr(open + 1, close - open - 1);
    shown = shown.substr(0, shown.find('<'));
    std::size_t wrong = 0;
    const auto path = unescaped_bytes(shown, wrong);
    if (!path || as_text(*path) != *wanted_) return nullptr;
    file = std::make_shared<TracedFile>();
    file->path = *wanted_;
    file->opened_us = call.begin_us;
    files_.open(call.thread, *fd, file, false);
    if (const Result<void> chosen = choose(file); !chosen) return nullptr;
    return file;
  }

  Result<void> take_read(const StraceCall& call) {
    const TracedFiles::File file = file_of(call);
    if (!file || (!is_device(file) && !is_candidate(file))) return {};
    if (call.error == "EIO")
      return step(file, {end_of(call), Event(event::DeviceLost{"a read failed: the line hung up", true})});
    if (call.result.value_or(0) <= 0) return {};
    if (!call.end_us) late_reads_ = true;
    return take_bytes(file, call, Direction::read, end_of(call));
  }
  Result<void> take_write(const StraceCall& call) {
    const TracedFiles::File file = file_of(call);
    if (!file || *call.result == 0 || (!is_device(file) && !is_candidate(file))) return {};
    return take_bytes(file, call, Direction::write, call.begin_us);
  }

  Result<void> take_bytes(const TracedFiles::File& file, const StraceCall& call, Direction direction,
                          std::int64_t us) {
    std::string_view data = strace_argument(call.args, 1);
    if (const std::size_t vectors = data.find("msg_iov="); vectors != std::string_view::npos)
      data.remove_prefix(vectors);
    Bytes bytes;
    for (const StraceString& part : strace_strings(data)) append(bytes, part.bytes);
    const auto told = static_cast<std::size_t>(*call.result);
    bytes.resize(std::min(bytes.size(), told));
    const std::size_t missing = told - bytes.size();
    TracedStep what{us, std::pair(direction, std::move(bytes))};
    if (call.interrupted && direction == Direction::write) what.until_us = call.end_us;
    if (Result<void> put = step(file, std::move(what)); !put || missing == 0) return put;
    if (is_device(file) && cut_bytes_ == 0) first_cut_ = line().number;
    if (is_device(file)) cut_bytes_ += missing;
    return step(
        file,
        {us, Event(event::Gap{missing, std::nullopt, "strace printed only the first bytes (option -s)"})});
  }

  Result<void> take_ioctl(const StraceCall& call) {
    const TracedFiles::File file = file_of(call);
    if (!file) return {};
    const std::string_view request = strace_argument(call.args, 1);
    if (request.find("TCGETS") == std::string_view::npos &&
        request.find("TCSETS") == std::string_view::npos) {
      if (!is_device(file)) return {};
    } else if (!is_device(file) && is_candidate(file)) {
      if (Result<void> chosen = choose(file); !chosen) return chosen;
    }
    if (!is_device(file)) return {};
    const std::int64_t end = call.end_us.value_or(call.begin_us);
    if (request == "TCSBRK" && strace_argument(call.args, 2) != "0")
      return step(file, {end, Event(event::Drain{Micros(end - call.begin_us)})});
    if (request == "TCSBRK" || request == "TCSBRKP") {
      if (Result<void> put = step(file, {call.begin_us, Event(event::Break{true, Side::driver})}); !put)
        return put;
      breaking_ = call.thread;
      return call.end_us ? end_break(*call.end_us) : Result<void>();
    }
    StraceTerminal::Asked asked = terminal_.asked(request, strace_argument(call.args, 2));
    if (!asked.problem.empty()) tape().problem_of_line(line().number, asked.problem);
    for (Event& event : asked.events) {
      if (Result<void> put = step(file, {call.begin_us, std::move(event)}); !put) return put;
    }
    return {};
  }

  Result<void> end_break(std::int64_t us) {
    breaking_.reset();
    return put({us, Event(event::Break{false, Side::driver})});
  }

  [[nodiscard]] bool is_device(const TracedFiles::File& file) const { return file->is_device; }
  [[nodiscard]] bool is_candidate(const TracedFiles::File& file) const {
    return device_path_.empty() && file->may_be_device;
  }

  // It is the device that the tape is of, opened then.
  Result<void> choose(const TracedFiles::File& file) {
    file->is_device = true;
    if (device_path_.empty()) {
      device_path_ = file->path;
      zero_us_ = file->opened_us;
      TapeHeader header;
      header.device = (file->is_socket ? "tcp:" : "serial:") + file->path;
      header.transport = Transport::stream;
      header.stamped = Stamped::read;
      header.origin = TapeOrigin{
          "convert", {{{}, evidence().name().substr(evidence().name().rfind('/') + 1)}}, std::nullopt};
      if (lines_.has_dates()) header.zero = TapeZero{wall_text(Micros(zero_us_)), 0, ""};
      if (Result<void> told = tape().header(header); !told) return told;
    }
    std::erase_if(opened_, [](const auto& each) { return each.expired(); });
    const bool first = opened_.empty();
    opened_.push_back(file);
    if (first) {
      terminal_ = {};
      if (Result<void> put = this->put({file->opened_us, Event(event::Open{})}); !put) return put;
    }
    for (TracedStep& each : std::exchange(file->steps, {})) {
      if (Result<void> put = this->put(std::move(each)); !put) return put;
    }
    return {};
  }

  Result<void> step(const TracedFiles::File& file, TracedStep what) {
    what.line = line().number;
    if (is_device(file)) return put(std::move(what));
    file->steps.push_back(std::move(what));
    if (file->steps.size() <= kMostPending) return {};
    file->steps.clear();  // so much, and nothing that is asked of a tty: it is none
    file->may_be_device = false;
    return {};
  }

  Result<void> put(TracedStep what) {
    tape().at_line(what.line > 0 ? what.line : line().number);
    TapeTime at = time_of(what.us);
    if (const auto* const event = std::get_if<Event>(&what.what)) return tape().event(at, *event);
    if (what.until_us) at = std::clamp(tape().latest(), at, std::max(at, time_of(*what.until_us)));
    const auto& [direction, bytes] = std::get<1>(what.what);
    tape().keep_order(!what.until_us);
    const Result<void> put = tape().block(
        direction, lines_.has_times() || !tape().options().bytes_at ? std::optional(at) : std::nullopt,
        bytes);
    tape().keep_order();
    return put;
  }

  // Its last descriptor may have gone.
  Result<void> look_for_close() {
    if (opened_.empty()) return {};
    std::erase_if(opened_, [](const auto& each) { return each.expired(); });
    if (!opened_.empty()) return {};
    return put({last_begin_us_, Event(event::Close{})});
  }

  [[nodiscard]] TapeTime time_of(std::int64_t us) const {
    return tape_time_us(std::max<std::int64_t>(us - zero_us_, 0));
  }
  static std::int64_t end_of(const StraceCall& call) { return call.end_us.value_or(call.begin_us); }

  void tell_problems() {
    if (!lines_.has_times())
      tape().guessed("there are no times in it (strace -ttt -T writes them); a line is a microsecond");
    if (late_reads_ && lines_.has_times())
      tape().guessed("reads have the times at which they were called (strace -T tells when they ended)");
    if (cut_bytes_ > 0)
      tape().problem(
          fmt::format("{} bytes are missing, first in line {}: strace printed only the first ones; -s 65536 "
                      "prints them all",
                      cut_bytes_, first_cut_));
  }

  [[nodiscard]] Error nothing_found() const {
    if (wanted_)
      return make_error(Errc::not_a_tape, fmt::format("{}: nothing is done with {} in it", evidence().name(),
                                                      in_quotes(*wanted_)));
    return make_error(
        Errc::not_a_tape,
        evidence().name() + ": no tty is opened in it; --device PATH or HOST:PORT names what is meant");
  }

  std::optional<std::string> wanted_;
  StraceLines lines_;
  TracedFiles files_;
  StraceTerminal terminal_;
  std::string device_path_;  // empty: not found yet
  std::int64_t zero_us_ = 0;
  std::int64_t now_us_ = 0;  // the latest
  std::int64_t last_begin_us_ = 0;
  std::vector<std::weak_ptr<TracedFile>> opened_;
  std::optional<std::uint32_t> breaking_;  // the thread whose break ends when its next call begins
  bool late_reads_ = false;
  std::uint64_t cut_bytes_ = 0;
  std::uint64_t first_cut_ = 0;
};

}  // namespace

Result<std::optional<TapeTime>> import_strace(Evidence& from, ImportTape& to,
                                              const ConvertProgress& progress) {
  return StraceImport(from, to).run(progress);
}

int detect_strace(std::string_view head) {
  StraceLines lines;
  int calls = 0;
  int others = 0;
  for (int n = 0; n < 50; ++n) {
    const std::size_t newline = head.find('\n');
    if (newline == std::string_view::npos) break;
    const StraceLines::Line line = lines.read(head.substr(0, newline));
    ++(line.call ? calls : others);
    head.remove_prefix(newline + 1);
  }
  return calls > others ? 85 : 0;
}

}  // namespace porttape
