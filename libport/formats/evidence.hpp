#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// What a tape is made of: a file, a pipe or stdin, read from front to back, by bytes or by lines, in constant
// memory. Owns its descriptor. After an error every further call gives it again. Not thread-safe.
class Evidence {
 public:
  static constexpr std::size_t kPeeked = std::size_t{64} * 1024;
  static constexpr std::size_t kLongestLine = std::size_t{16} << 20U;

  // `-` is stdin. Errc::usage: not there, a folder, not readable.
  static Result<Evidence> open(const std::string& path);
  // Of bytes in memory.
  static Evidence of(std::string name, std::string_view bytes);

  // What comes next, at most `most` (up to kPeeked) bytes; shorter only where it ends. Valid until the next
  // call. Errc::io.
  Result<ByteView> peek(std::size_t most = kPeeked);
  // Fills `into`; fewer bytes only where it ends.
  Result<std::size_t> read(std::span<Byte> into);
  // Bytes that were there.
  Result<std::uint64_t> skip(std::uint64_t bytes);

  struct Line {
    std::string_view text;     // without its end ("\n" or "\r\n"); valid until the next call
    std::uint64_t number = 0;  // from 1
    std::uint64_t offset = 0;  // of its first byte
    bool whole = true;         // false: the evidence ends without a newline
  };
  // Nothing: the end. Errc::damaged_tape: longer than kLongestLine.
  Result<std::optional<Line>> line();

  [[nodiscard]] std::uint64_t offset() const { return offset_; }  // of the next byte
  [[nodiscard]] const std::string& name() const { return name_; }
  // All bytes there are, where that is known.
  [[nodiscard]] std::optional<std::uint64_t> size() const { return size_; }

  // An error at a place: "laser.txt:12:7: WHAT" (Errc::damaged_tape).
  [[nodiscard]] Error error_at(const Line& line, std::size_t column, std::string_view what) const;
  // "laser.pcapng at byte 1024: WHAT".
  [[nodiscard]] Error error_at(std::uint64_t offset, std::string_view what) const;

 private:
  Evidence(std::string name, UniqueFd fd) : name_(std::move(name)), fd_(std::move(fd)) {}
  Result<void> fill(std::size_t wanted);
  [[nodiscard]] std::size_t kept() const { return buffer_.size() - begin_; }
  void take(std::size_t bytes);

  std::string name_;
  UniqueFd fd_;  // none: all is in the buffer
  Bytes buffer_;
  std::size_t begin_ = 0;
  std::uint64_t offset_ = 0;
  std::uint64_t lines_ = 0;
  std::optional<std::uint64_t> size_;
  bool ended_ = false;
  std::string trouble_;
};

}  // namespace porttape
