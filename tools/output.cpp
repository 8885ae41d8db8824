#include "tools/output.hpp"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <sys/ioctl.h>
#include <unistd.h>

#include "libport/base/error.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

constexpr std::size_t kBufferSize = std::size_t{64} * 1024;
constexpr std::size_t kUsualColumns = 80;

}  // namespace

FdStreambuf::FdStreambuf(int fd) : fd_(fd), buffer_(std::make_unique_for_overwrite<char[]>(kBufferSize)) {
  setp(buffer_.get(), buffer_.get() + kBufferSize);
}

int FdStreambuf::sync() {
  const char* from = pbase();
  while (error_ == 0 && from < pptr()) {
    const ssize_t written = ::write(fd_, from, static_cast<std::size_t>(pptr() - from));
    if (written >= 0) {
      from += written;
    } else if (errno != EINTR) {
      error_ = errno;
    }
  }
  setp(buffer_.get(), buffer_.get() + kBufferSize);
  return error_ == 0 ? 0 : -1;
}

FdStreambuf::int_type FdStreambuf::overflow(int_type c) {
  if (sync() != 0) return traits_type::eof();
  if (!traits_type::eq_int_type(c, traits_type::eof())) sputc(traits_type::to_char_type(c));
  return traits_type::not_eof(c);
}

OptionSpec color_option() {
  return {
      "color", OptionSpec::Kind::choice,   "auto", "auto: colours on a terminal, unless NO_COLOR is set", 0,
      0,       {"auto", "always", "never"}};
}

Result<ColorChoice> read_color(std::string_view value) {
  const Result<std::string> choice = check_value(color_option(), value);
  if (!choice) return choice.error();
  if (*choice == "always") return ColorChoice::always;
  return *choice == "never" ? ColorChoice::never : ColorChoice::automatic;
}

std::string_view color_begin(Color color, bool wanted) {
  if (!wanted) return {};
  constexpr std::array<std::string_view, 6> codes = {"\x1b[32m", "\x1b[36m", "\x1b[33m",
                                                     "\x1b[32m", "\x1b[33m", "\x1b[31m"};
  return codes.at(static_cast<std::size_t>(color));
}

Color color_of(Judgement::Verdict verdict) {
  switch (verdict) {
    case Judgement::Verdict::sound:
      return Color::good;
    case Judgement::Verdict::damaged:
      return Color::bad;
    case Judgement::Verdict::unchecked:
    case Judgement::Verdict::flawed:
      break;
  }
  return Color::doubtful;
}

std::string_view color_end(bool wanted) { return wanted ? "\x1b[0m" : ""; }

int descriptor_of(const std::ostream& out) {
  const auto* buffer = dynamic_cast<const FdStreambuf*>(out.rdbuf());
  return buffer == nullptr ? -1 : buffer->fd();
}

std::optional<std::size_t> columns_of(const std::ostream& out) {
  if (const char* const given = std::getenv("COLUMNS"); given != nullptr) {
    if (const auto columns = whole_number<std::size_t>(given); columns && *columns > 0) return columns;
  }
  const int fd = descriptor_of(out);
  winsize size{};
  if (fd < 0 || ::isatty(fd) != 1) return std::nullopt;
  if (::ioctl(fd, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return kUsualColumns;
  return size.ws_col;
}

bool wants_color(const std::ostream& out, ColorChoice choice) {
  if (choice != ColorChoice::automatic) return choice == ColorChoice::always;
  const int fd = descriptor_of(out);
  if (fd < 0 || ::isatty(fd) != 1) return false;
  const char* no_color = std::getenv("NO_COLOR");
  return no_color == nullptr || *no_color == '\0';
}

int output_status(const std::ostream& out, int status) {
  const auto* buffer = dynamic_cast<const FdStreambuf*>(out.rdbuf());
  const bool failed = buffer != nullptr && buffer->error() != 0 && buffer->error() != EPIPE;
  return failed && status == exit_status::kPass ? exit_status::kRuntime : status;
}

int finish_output(std::ostream& out, int status, std::ostream& err) {
  out.flush();
  const auto* buffer = dynamic_cast<const FdStreambuf*>(out.rdbuf());
  if (buffer == nullptr || buffer->error() == 0 || buffer->error() == EPIPE) return status;
  err << "porttape: cannot write to standard output: " << errno_text(buffer->error()) << '\n';
  return output_status(out, status);
}

}  // namespace porttape
