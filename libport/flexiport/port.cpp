// What Port gives to ports that programs derive from it: everything that follows from Read, Write and the
// rest.

#include <atomic>
#include <charconv>
#include <cmath>
#include <cstring>
#include <flexiport/port.h>
#include <fmt/format.h>
#include <type_traits>

namespace flexiport {
namespace {

constexpr size_t kStringPiece = 1024;
constexpr double kMaxSeconds = 1e9;
constexpr double kMicrosPerSecond = 1e6;

double to_number(const std::string& option, const std::string& value) {
  double number = 0;
  const char* const last = value.data() + value.size();
  const auto [end, error] = std::from_chars(value.data(), last, number, std::chars_format::fixed);
  if (error != std::errc{} || end != last || !std::isfinite(number)) {
    throw PortException("Bad value for option " + option + ": " + value);
  }
  return number;
}

Timeout to_timeout(const std::string& value) {
  const double seconds = to_number("timeout", value);
  if (seconds == -1) return Timeout(-1, 0);
  if (seconds < 0 || seconds > kMaxSeconds) throw PortException("Bad value for option timeout: " + value);
  const double whole = std::floor(seconds);
  return Timeout(static_cast<int>(whole),
                 static_cast<int>(std::lround((seconds - whole) * kMicrosPerSecond)));
}

bool is_on(const std::string& option, const std::string& value) {
  if (value == "1" || value == "on" || value == "yes" || value == "true") return true;
  if (value == "0" || value == "off" || value == "no" || value == "false") return false;
  throw PortException("Bad value for option " + option + ": " + value);
}

// The members have the types and places that old programs know, and may be read and set by several threads.
template <class Value>
Value get(const Value& member) {
  return std::atomic_ref<Value>(const_cast<Value&>(member)).load(std::memory_order_relaxed);
}

template <class Value>
void set(Value& member, std::type_identity_t<Value> value) {
  std::atomic_ref<Value>(member).store(value, std::memory_order_relaxed);
}

}  // namespace

Port::Port() : _debug(0), _timeout(-1, 0), _canRead(true), _canWrite(true), _alwaysOpen(false) {}

Port::Port(unsigned int debug, Timeout timeout, bool canRead, bool canWrite, bool alwaysOpen)
    : _debug(debug), _timeout(timeout), _canRead(canRead), _canWrite(canWrite), _alwaysOpen(alwaysOpen) {}

Port::~Port() = default;

void Port::ProcessOptions(const std::map<std::string, std::string>& options) {
  for (const auto& [option, value] : options) {
    if (option != "type" && !ProcessOption(option, value)) throw PortException("Unknown option: " + option);
  }
}

bool Port::ProcessOption(const std::string& option, const std::string& value) {
  if (option == "debug") {
    const double debug = to_number(option, value);
    if (debug < 0 || debug > kMaxSeconds) throw PortException("Bad value for option debug: " + value);
    _debug = static_cast<unsigned>(debug);
  } else if (option == "timeout") {
    _timeout = to_timeout(value);
  } else if (option == "readonly") {
    _canWrite = !is_on(option, value);
  } else if (option == "writeonly") {
    _canRead = !is_on(option, value);
  } else if (option == "readwrite") {
    if (is_on(option, value)) _canRead = _canWrite = true;
  } else if (option == "alwaysopen") {
    _alwaysOpen = is_on(option, value);
  } else {
    return false;
  }
  return true;
}

void Port::CheckPort(bool read) {
  if (!IsOpen()) throw PortException("Port is not open.");
  if (read && !get(_canRead)) throw PortException("Port may not be read from.");
  if (!read && !get(_canWrite)) throw PortException("Port may not be written to.");
}

ssize_t Port::ReadString(std::string& buffer) {
  char piece[kStringPiece];
  const ssize_t size = Read(piece, sizeof piece);
  if (size > 0) buffer.assign(piece, static_cast<size_t>(size));
  return size;
}

ssize_t Port::ReadUntil(void* const buffer, size_t count, uint8_t terminator) {
  uint8_t* const bytes = static_cast<uint8_t*>(buffer);
  for (size_t used = 0; used < count; ++used) {
    const ssize_t size = Read(bytes + used, 1);
    if (size <= 0) return size;
    if (bytes[used] == terminator) return static_cast<ssize_t>(used + 1);
  }
  return static_cast<ssize_t>(count);
}

ssize_t Port::ReadStringUntil(std::string& buffer, char terminator) {
  buffer.clear();
  for (char next = 0;;) {
    const ssize_t size = Read(&next, 1);
    if (size <= 0) return size;
    buffer += next;
    if (next == terminator) return static_cast<ssize_t>(buffer.size());
  }
}

ssize_t Port::ReadLine(char* const buffer, size_t count) {
  if (count == 0) return 0;
  const ssize_t size = ReadUntil(buffer, count - 1, '\n');
  buffer[size > 0 ? size : 0] = '\0';
  return size;
}

ssize_t Port::ReadLine(std::string& buffer) { return ReadStringUntil(buffer, '\n'); }

ssize_t Port::Skip(size_t count) {
  char dropped = 0;
  for (size_t skipped = 0; skipped < count; ++skipped) {
    const ssize_t size = Read(&dropped, 1);
    if (size <= 0) return size;
  }
  return static_cast<ssize_t>(count);
}

ssize_t Port::SkipUntil(uint8_t terminator, unsigned int count) {
  ssize_t skipped = 0;
  for (uint8_t next = 0; count > 0; ++skipped) {
    const ssize_t size = Read(&next, 1);
    if (size <= 0) return size;
    if (next == terminator) --count;
  }
  return skipped;
}

ssize_t Port::WriteFull(const void* const buffer, size_t count) {
  const uint8_t* const bytes = static_cast<const uint8_t*>(buffer);
  size_t sent = 0;
  while (sent < count) {
    const ssize_t size = Write(bytes + sent, count - sent);
    if (size <= 0) throw PortException(fmt::format("Only {} of {} bytes could be written.", sent, count));
    sent += static_cast<size_t>(size);
  }
  return static_cast<ssize_t>(sent);
}

ssize_t Port::WriteString(const char* const buffer) { return WriteFull(buffer, std::strlen(buffer)); }
ssize_t Port::WriteString(const std::string& buffer) { return WriteFull(buffer.data(), buffer.size()); }

std::string Port::GetStatus() const {
  const Timeout timeout = Port::GetTimeout();
  const bool reads = Port::CanRead();
  const bool writes = Port::CanWrite();
  const std::string waits =
      timeout._sec < 0 ? "for ever" : fmt::format("{}.{:06} s", timeout._sec, timeout._usec);
  return fmt::format("Type: {}\nDebug level: {}\nTimeout: {}\nPermissions: {}{}{}\n", _type, _debug, waits,
                     reads ? "read" : "", reads && writes ? ", " : "", writes ? "write" : "") +
         (_alwaysOpen ? "Always open\n" : "");
}

void Port::SetTimeout(Timeout timeout) {
  set(_timeout._sec, timeout._sec);
  set(_timeout._usec, timeout._usec);
}
Timeout Port::GetTimeout() const { return Timeout(get(_timeout._sec), get(_timeout._usec)); }
bool Port::IsBlocking() const { return get(_timeout._sec) != 0 || get(_timeout._usec) != 0; }
void Port::SetCanRead(bool canRead) { set(_canRead, canRead); }
bool Port::CanRead() const { return get(_canRead); }
void Port::SetCanWrite(bool canWrite) { set(_canWrite, canWrite); }
bool Port::CanWrite() const { return get(_canWrite); }

}  // namespace flexiport
