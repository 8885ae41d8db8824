#include "tools/output.hpp"

#include <cerrno>
#include <cstdlib>
#include <unistd.h>

#include "libport/base/error.hpp"

namespace porttape {
namespace {

constexpr std::size_t kBufferSize = std::size_t{64} * 1024;

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

bool wants_color(const std::ostream& out) {
  const auto* buffer = dynamic_cast<const FdStreambuf*>(out.rdbuf());
  if (buffer == nullptr || ::isatty(buffer->fd()) != 1) return false;
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
