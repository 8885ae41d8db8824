#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <ostream>
#include <streambuf>
#include <string_view>

#include "libport/base/result.hpp"
#include "libport/port/port_type.hpp"
#include "libport/tape/judgement.hpp"

namespace porttape {

// A stream buffer on a file descriptor that remembers why a write failed. Does not own the descriptor.
class FdStreambuf final : public std::streambuf {
 public:
  explicit FdStreambuf(int fd);
  ~FdStreambuf() override { FdStreambuf::sync(); }
  FdStreambuf(const FdStreambuf&) = delete;
  FdStreambuf& operator=(const FdStreambuf&) = delete;

  // The errno of the first write that failed, 0 if none has. After it nothing more is written.
  [[nodiscard]] int error() const { return error_; }
  [[nodiscard]] int fd() const { return fd_; }

 protected:
  int_type overflow(int_type c) override;
  int sync() override;

 private:
  int fd_;
  int error_ = 0;
  std::unique_ptr<char[]> buffer_;
};

// Which colours a user wants (--color): by default those of a terminal, unless NO_COLOR is set.
enum class ColorChoice { automatic, always, never };
// The option --color, and what its value says. Errc::usage.
OptionSpec color_option();
Result<ColorChoice> read_color(std::string_view value);
bool wants_color(const std::ostream& out, ColorChoice choice = ColorChoice::automatic);

// What each colour stands for, in all verbs.
enum class Color {
  read,   // from the device
  write,  // from the driver
  event,
  good,
  doubtful,
  bad
};
// Before a text and behind it; empty where no colours are wanted.
std::string_view color_begin(Color color, bool wanted);
std::string_view color_end(bool wanted);
Color color_of(Judgement::Verdict verdict);

// The descriptor behind it, -1 where there is none.
int descriptor_of(const std::ostream& out);

// Columns of a line there: $COLUMNS, else what the terminal has; none where it is no terminal.
std::optional<std::size_t> columns_of(const std::ostream& out);

// `status`, or 1 where that is 0 and what was flushed to `out` could not be written. A reader that went away
// is no error.
int output_status(const std::ostream& out, int status);

// The exit status of a program that ends with `status`, after the last flush of its output: as
// output_status(), and what kept output from being written is told on `err`.
int finish_output(std::ostream& out, int status, std::ostream& err);

}  // namespace porttape
