#pragma once

#include <memory>
#include <string>

#include "daemon/log_queue.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A file, or stderr. Its descriptor is written as it is; whose it is besides is not known, so its flags are
// left alone.
class FileTarget final : public LogTarget {
 public:
  // A file that is made if need be and added to; a link is followed that is our user's or root's. One that is
  // a pipe without a reader keeps what a pipe holds.
  static Result<std::unique_ptr<LogTarget>> open(const std::string& path);
  static std::unique_ptr<LogTarget> stderr_target();

  bool write(std::string_view lines) override;
  void reopen() override;

 private:
  FileTarget(UniqueFd fd, std::string path) : fd_(std::move(fd)), path_(std::move(path)) {}

  UniqueFd fd_;
  std::string path_;  // empty: cannot be opened again
};

// A datagram socket that takes one line a message: the journal's or syslog's. Connects again when the one who
// listened has been restarted.
class SocketTarget final : public LogTarget {
 public:
  enum class Protocol { journal, syslog };

  // Nothing when nobody listens there.
  static std::unique_ptr<LogTarget> connect(const std::string& path, Protocol protocol);

  bool write(std::string_view lines) override;

 private:
  SocketTarget(std::string path, Protocol protocol) : path_(std::move(path)), protocol_(protocol) {}
  bool connect_again();
  bool send(const std::string& message);

  UniqueFd fd_;
  std::string path_;
  Protocol protocol_;
};

// What a line with a priority in front ("<6>text") is as a message of the protocol.
std::string as_message(SocketTarget::Protocol protocol, std::string_view line);

}  // namespace porttape
