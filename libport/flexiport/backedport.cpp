#include <algorithm>
#include <flexiport/backedport.h>
#include <flexiport/logreaderport.h>
#include <flexiport/logwriterport.h>
#include <flexiport/serialport.h>
#include <flexiport/tcpport.h>
#include <flexiport/udpport.h>
#include <memory>
#include <span>
#include <typeinfo>
#include <utility>

#include <spdlog/logger.h>
#include <spdlog/sinks/stdout_sinks.h>

#include "libport/flexiport/backing.hpp"

namespace flexiport {
namespace {

using porttape::BlockingPort;
using porttape::Byte;
using porttape::Result;
using porttape::Transfer;

std::shared_ptr<spdlog::logger> make_log(const std::string& name, unsigned debug) {
  if (debug == 0) return {};
  auto log = std::make_shared<spdlog::logger>(name, std::make_shared<spdlog::sinks::stderr_sink_mt>());
  log->set_level(debug == 1 ? spdlog::level::info : debug == 2 ? spdlog::level::debug : spdlog::level::trace);
  return log;
}

std::span<Byte> room(void* buffer, size_t count) { return {static_cast<Byte*>(buffer), count}; }
porttape::ByteView bytes(const void* buffer, size_t count) {
  return {static_cast<const Byte*>(buffer), count};
}

ssize_t read_value(const Result<Transfer>& result) {
  if (!result) raise(result.error());
  if (result->end == Transfer::End::timed_out) return -1;
  return static_cast<ssize_t>(result->bytes);
}

ssize_t write_value(const Result<Transfer>& result) {
  if (!result) raise(result.error());
  return static_cast<ssize_t>(result->bytes);
}

}  // namespace

BackedPort::BackedPort(const std::string& name, const std::string& type,
                       const std::map<std::string, std::string>& options) {
  _type = name;
  auto backing = std::make_unique<Backing>();
  _backing = backing.get();
  ProcessOptions(options);
  std::map<std::string, std::string> own = std::move(backing->options);
  own["type"] = type;
  if (_alwaysOpen) own["alwaysopen"] = "1";
  if (!_canWrite) own["readonly"] = "1";
  if (!_canRead) own["writeonly"] = "1";
  Result<std::unique_ptr<BlockingPort>> port = [&] {
    try {
      return BlockingPort::create(std::move(own), make_log(name, _debug));
    } catch (const std::exception& error) {  // out of descriptors or memory
      throw PortException(std::string("The port cannot be made: ") + error.what());
    }
  }();
  if (!port) raise(port.error());
  backing->port = std::move(*port);
  backing->port->set_timeout(to_micros(_timeout));
  if (_alwaysOpen) {
    Open();
    backing->opened_by_option = true;
  }
  backing.release();
}

BackedPort::~BackedPort() { delete _backing; }

// A program's own class may have its own Read() or Write(): what is made of those must call them.
bool BackedPort::derived() const {
  return typeid(*this) != typeid(SerialPort) && typeid(*this) != typeid(TCPPort) &&
         typeid(*this) != typeid(UDPPort) && typeid(*this) != typeid(LogReaderPort) &&
         typeid(*this) != typeid(LogWriterPort) && !_backing->other;
}

bool BackedPort::ProcessOption(const std::string& option, const std::string& value) {
  if (!Port::ProcessOption(option, value)) _backing->options[option] = value;
  return true;
}

void BackedPort::CheckPort(bool read) {
  if (read && Port::CanRead() && _backing->port->readable()) return;  // what came before the line went down
  Port::CheckPort(read);
}

void BackedPort::Open() {
  if (_backing->opened_by_option.exchange(false) && IsOpen()) return;
  if (IsOpen()) throw PortException("Port is already open.");
  if (const Result<void> opened = _backing->port->open(); !opened) raise(opened.error());
}

void BackedPort::Close() {
  _backing->opened_by_option = false;
  _backing->port->close();
}

ssize_t BackedPort::Read(void* const buffer, size_t count) {
  CheckPort(true);
  return read_value(_backing->port->read(room(buffer, count)));
}

ssize_t BackedPort::ReadFull(void* const buffer, size_t count) {
  CheckPort(true);
  return read_value(_backing->port->read_full(room(buffer, count)));
}

ssize_t BackedPort::ReadString(std::string& buffer) {
  if (derived()) return Port::ReadString(buffer);
  CheckPort(true);
  return read_value(_backing->port->read_string(buffer));
}

ssize_t BackedPort::ReadUntil(void* const buffer, size_t count, uint8_t terminator) {
  if (derived()) return Port::ReadUntil(buffer, count, terminator);
  CheckPort(true);
  return read_value(_backing->port->read_until(room(buffer, count), terminator));
}

ssize_t BackedPort::ReadStringUntil(std::string& buffer, char terminator) {
  if (derived()) return Port::ReadStringUntil(buffer, terminator);
  CheckPort(true);
  return read_value(_backing->port->read_string_until(buffer, terminator));
}

ssize_t BackedPort::ReadLine(char* const buffer, size_t count) { return Port::ReadLine(buffer, count); }

ssize_t BackedPort::ReadLine(std::string& buffer) { return ReadStringUntil(buffer, '\n'); }

ssize_t BackedPort::Skip(size_t count) {
  if (derived()) return Port::Skip(count);
  CheckPort(true);
  return read_value(_backing->port->skip(count));
}

ssize_t BackedPort::SkipUntil(uint8_t terminator, unsigned int count) {
  if (derived()) return Port::SkipUntil(terminator, count);
  CheckPort(true);
  return read_value(_backing->port->skip_until(terminator, count));
}

ssize_t BackedPort::BytesAvailable() {
  CheckPort(true);
  const Result<std::size_t> there = _backing->port->bytes_available();
  if (!there) raise(there.error());
  return static_cast<ssize_t>(*there);
}

ssize_t BackedPort::BytesAvailableWait() {
  CheckPort(true);
  return read_value(_backing->port->bytes_available_wait());
}

ssize_t BackedPort::Write(const void* const buffer, size_t count) {
  CheckPort(false);
  return write_value(_backing->port->write(bytes(buffer, count)));
}

ssize_t BackedPort::WriteFull(const void* const buffer, size_t count) {
  if (derived()) return Port::WriteFull(buffer, count);
  CheckPort(false);
  return write_value(_backing->port->write_full(bytes(buffer, count)));
}

void BackedPort::Flush() {
  Port::CheckPort(Port::CanRead());
  if (const Result<void> done = _backing->port->flush(); !done) raise(done.error());
}

void BackedPort::Drain() {
  CheckPort(false);
  if (const Result<Transfer> done = _backing->port->drain(); !done) raise(done.error());
}

std::string BackedPort::GetStatus() const { return Port::GetStatus() + _backing->port->status(); }

void BackedPort::SetTimeout(Timeout timeout) {
  Port::SetTimeout(timeout);
  _backing->port->set_timeout(to_micros(timeout));
}

void BackedPort::SetCanRead(bool canRead) {
  Port::SetCanRead(canRead);
  _backing->port->set_can_read(canRead);
}

void BackedPort::SetCanWrite(bool canWrite) {
  Port::SetCanWrite(canWrite);
  _backing->port->set_can_write(canWrite);
}

bool BackedPort::IsOpen() const { return _backing->port->is_open(); }

}  // namespace flexiport
