#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "libport/tape/byte_source.hpp"
#include "libport/tape/event.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// Reads the events file line by line through one buffer of kMaxLine bytes. Owns the source.
//
// Drive it by next() until it gives `end` or `failed`, which then come again; rewind() starts again. event()
// and line() are valid until the next call. header() is there from the start: create() has read it. A line
// that is not as it was written is damage, as far as the file tells that: see FORMAT.md, `events_xxh3`.
class EventFile {
 public:
  static constexpr std::size_t kMaxLine = std::size_t{64} * 1024;  // a longer line is damage

  enum class Step : std::uint8_t { event, end, failed };

  // Errc::damaged_tape: the first line is whole and no header. Errc::not_a_tape: it is one of another
  // version. Errc::io.
  static Result<EventFile> create(std::unique_ptr<ByteSource> source);

  Step next();
  void rewind();
  // After `end`: goes on there, for a file that may have grown since.
  void read_on();

  [[nodiscard]] const TapeEvent& event() const { return event_; }
  // The event's whole JSON object, without the newline.
  [[nodiscard]] std::string_view line() const { return line_; }
  [[nodiscard]] const Error& error() const {
    return *error_;
  }  // after `failed`: Errc::damaged_tape or Errc::io
  // Nothing if the file ended before its first line did. A `zero` event that has come replaces its zero.
  [[nodiscard]] const std::optional<TapeHeader>& header() const { return header_; }
  // Its line, without the newline; empty where there is none.
  [[nodiscard]] const std::string& header_line() const { return header_line_; }
  // After `end`: an unfinished last line as a note for a person, nothing if there is none.
  [[nodiscard]] std::optional<std::string> torn_tail() const;
  [[nodiscard]] const std::string& name() const { return source_->name(); }

 private:
  explicit EventFile(std::unique_ptr<ByteSource> source);
  Result<void> read_header();
  Result<std::optional<std::string_view>> next_line();
  Step take(std::string_view line);
  [[nodiscard]] Result<void> check(std::string_view line, const Event& event) const;
  [[nodiscard]] Result<void> check_unfinished() const;
  void pass(std::string_view line);
  Step fail(Error error);
  [[nodiscard]] Error damage(const std::string& reason) const;

  std::unique_ptr<ByteSource> source_;
  std::unique_ptr<char[]> buffer_;
  std::size_t begin_ = 0;  // the unread bytes are [begin_, end_) of the buffer
  std::size_t end_ = 0;
  std::uint64_t offset_ = 0;  // in the file, of end_
  std::uint64_t line_number_ = 0;
  StreamDigest lines_;  // of all before the current one
  std::optional<TapeHeader> header_;
  std::string header_line_;
  TapeEvent event_;
  std::string_view line_;
  bool ended_ = false;
  bool torn_ = false;
  std::optional<Error> error_;
};

// The header of a tape's events file; nothing where it cannot be read.
std::optional<TapeHeader> header_of(const TapePaths& tape);

}  // namespace porttape
