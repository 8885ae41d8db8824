#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "libport/base/time.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/payload_totals.hpp"
#include "libport/tape/tape_header.hpp"

namespace porttape {

// One line of the events file behind the header. Of the keys only those that porttape itself uses are taken
// apart.
struct TapeEvent {
  TapeTime at{};
  std::string kind;                   // "open", "mark", …; may be unknown
  std::string text;                   // mark
  std::string why;                    // gap
  std::uint64_t bytes = 0;            // gap
  TapeTime from{};                    // gap: when it began
  bool hung_up = false;               // device-lost: the driver's line broke with it
  std::optional<PayloadTotals> read;  // end: what the r and w files hold; nothing where it does not say so
  std::optional<PayloadTotals> write;
  std::string_view line;  // the whole JSON object, without the newline
};

// Reads the events file line by line through one buffer of kMaxLine bytes. Owns the source.
//
// Drive it by next() until it gives `end` or `failed`, which then come again; rewind() starts again. event()
// is valid until the next call. header() is there from the start: create() has read it.
class EventFile {
 public:
  static constexpr std::size_t kMaxLine = std::size_t{64} * 1024;  // a longer line is damage

  enum class Step : std::uint8_t { event, end, failed };

  // Errc::not_a_tape: the first line is whole and is not a header this version reads. Errc::io.
  static Result<EventFile> create(std::unique_ptr<ByteSource> source);

  Step next();
  void rewind();

  [[nodiscard]] const TapeEvent& event() const { return event_; }
  [[nodiscard]] const Error& error() const {
    return *error_;
  }  // after `failed`: Errc::damaged_tape or Errc::io
  // Nothing if the file ended before its first line did. A `zero` event that has come replaces its zero.
  [[nodiscard]] const std::optional<TapeHeader>& header() const { return header_; }
  // After `end`: an unfinished last line as a note for a person, nothing if there is none.
  [[nodiscard]] std::optional<std::string> torn_tail() const;
  [[nodiscard]] const std::string& name() const { return source_->name(); }

 private:
  explicit EventFile(std::unique_ptr<ByteSource> source);
  Result<void> read_header();
  Result<std::optional<std::string_view>> next_line();
  std::string take(std::string_view line);
  Step fail(Error error);
  [[nodiscard]] Error damage(const std::string& reason) const;

  std::unique_ptr<ByteSource> source_;
  std::unique_ptr<char[]> buffer_;
  std::size_t begin_ = 0;  // the unread bytes are [begin_, end_) of the buffer
  std::size_t end_ = 0;
  std::uint64_t offset_ = 0;  // in the file, of end_
  std::uint64_t line_number_ = 0;
  std::optional<TapeHeader> header_;
  TapeEvent event_;
  bool ended_ = false;
  bool torn_ = false;
  std::optional<Error> error_;
};

// Lines of the events file, newline included.
std::string header_line(const TapeHeader& header);
std::string event_line(TapeTime at, std::string_view kind);
std::string mark_line(TapeTime at, std::string_view text);  // a long text is cut to 4096 bytes
std::string device_lost_line(TapeTime at, std::string_view why, bool hung_up);
std::string half_close_line(TapeTime at, std::string_view by);
std::string end_line(TapeTime at, const PayloadTotals& read, const PayloadTotals& write);
std::string flush_line(TapeTime at, std::string_view queue);
std::string gap_line(TapeTime at, std::uint64_t bytes, TapeTime from, std::string_view why);

}  // namespace porttape
