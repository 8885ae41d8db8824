#pragma once

#include <memory>
#include <ostream>
#include <streambuf>

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

// Whether colours are wanted there: a terminal, and NO_COLOR is not set.
bool wants_color(const std::ostream& out);

// `status`, or 1 where that is 0 and what was flushed to `out` could not be written. A reader that went away
// is no error.
int output_status(const std::ostream& out, int status);

// The exit status of a program that ends with `status`, after the last flush of its output: as
// output_status(), and what kept output from being written is told on `err`.
int finish_output(std::ostream& out, int status, std::ostream& err);

}  // namespace porttape
