#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <sys/types.h>

// What an old build of a driver knows of flexiport, written down again from the documented order, with
// nothing of this library's headers. Only mirror.cpp, a translation unit of its own, calls through it.
namespace mirror {

struct Timeout {
  int sec;
  int usec;
  // flexiport's has a copy constructor of its own, which makes it travel by reference.
  Timeout(int s, int us) : sec(s), usec(us) {}
  Timeout(const Timeout& other) : sec(other.sec), usec(other.usec) {}
  Timeout& operator=(const Timeout&) = delete;
};

class Port {
 public:
  virtual ~Port() = default;
  virtual void open() = 0;
  virtual void close() = 0;
  virtual ssize_t read(void*, std::size_t) = 0;
  virtual ssize_t read_full(void*, std::size_t) = 0;
  virtual ssize_t read_string(std::string&) = 0;
  virtual ssize_t read_until(void*, std::size_t, std::uint8_t) = 0;
  virtual ssize_t read_string_until(std::string&, char) = 0;
  virtual ssize_t read_line_into(char*, std::size_t) = 0;
  virtual ssize_t read_line(std::string&) = 0;
  virtual ssize_t skip(std::size_t) = 0;
  virtual ssize_t skip_until(std::uint8_t, unsigned) = 0;
  virtual ssize_t bytes_available() = 0;
  virtual ssize_t bytes_available_wait() = 0;
  virtual ssize_t write(const void*, std::size_t) = 0;
  virtual ssize_t write_full(const void*, std::size_t) = 0;
  virtual ssize_t write_text(const char*) = 0;
  virtual ssize_t write_string(const std::string&) = 0;
  virtual void flush() = 0;
  virtual void drain() = 0;
  [[nodiscard]] virtual std::string status() const = 0;
  virtual void set_timeout(Timeout) = 0;
  [[nodiscard]] virtual Timeout timeout() const = 0;
  [[nodiscard]] virtual bool is_blocking() const = 0;
  virtual void set_can_read(bool) = 0;
  [[nodiscard]] virtual bool can_read() const = 0;
  virtual void set_can_write(bool) = 0;
  [[nodiscard]] virtual bool can_write() const = 0;
  [[nodiscard]] virtual bool is_open() const = 0;

  std::string type;
  unsigned debug;
  Timeout wait;
  bool may_read;
  bool may_write;
  bool always_open;

 protected:
  virtual bool process_option(const std::string&, const std::string&) = 0;
  virtual void check_port(bool) = 0;
};

// Drives a port through the mirror; a line for each call with what it gave. The port ends at the end.
std::string drive(void* port);

struct Layout {
  std::size_t size, type, debug, timeout, can_read, can_write, always_open;
};
Layout layout();

}  // namespace mirror
