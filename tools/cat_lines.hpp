#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>

#include "libport/base/bytes.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_header.hpp"

namespace porttape {

// What one line of `porttape cat` says about blocks: one block, or a burst of them.
struct CatLine {
  Direction direction = Direction::read;
  TapeTime at{};
  TapeTime until{};  // time of its last block
  std::uint64_t stream_offset = 0;
  std::uint64_t length = 0;
  std::uint64_t blocks = 1;
};

// Prints the lines. A line is begin(), its data in one or more pieces, end(). Keeps a reference to `out`.
class CatPrinter {
 public:
  virtual ~CatPrinter() = default;
  // Where several tapes are printed: what comes is of this one. Not in the middle of a line.
  void of(std::string tape) { tape_ = std::move(tape); }
  virtual void begin(const CatLine& line) = 0;
  virtual void data(ByteView piece) = 0;
  virtual void end() = 0;
  // The record as it is on its tape, and when it was on the time of all.
  virtual void event(const Record& record, TapeTime at) = 0;

 protected:
  [[nodiscard]] const std::string& tape() const { return tape_; }  // empty: there is one

 private:
  std::string tape_;
};

// What an event says besides time and kind: `"text":"here"`; the whole line where it is not of the usual
// form. Of settings and signals, which people read more often: in words. Not safe to show as it is.
std::string event_details(const Event& event, TapeTime at, std::string_view line);

// For people: time, direction, length, text and hex. Of long data the first bytes only, as many as fit, or
// all of it in as many rows as it takes.
class TextCatPrinter final : public CatPrinter {
 public:
  static constexpr std::size_t kShown = 32;  // bytes of a line whose width is not limited

  enum class Form : std::uint8_t { both, text, hex };  // of the bytes
  enum class Times : std::uint8_t {
    tape,
    delta,  // since the line before
    wall
  };

  struct Layout {
    bool color = false;
    bool full = false;
    Form form = Form::both;
    Times times = Times::tape;
    TapeZero zero{};               // for Times::wall
    std::size_t tape_columns = 0;  // for the tapes' names
    std::optional<std::size_t> width =
        {};  // columns; none: as much as kShown takes, in full as a terminal has
  };

  TextCatPrinter(std::ostream& out, Layout layout) : out_(out), layout_(layout) {}
  void begin(const CatLine& line) override;
  void data(ByteView piece) override;
  void end() override;
  void event(const Record& record, TapeTime at) override;

 private:
  std::string head_text(TapeTime at);
  [[nodiscard]] std::size_t columns_of(Byte byte) const;
  [[nodiscard]] std::string row_text(std::string_view more) const;
  [[nodiscard]] std::size_t room() const;
  void add(Byte byte);
  void print_row(std::string_view more);

  std::ostream& out_;
  Layout layout_;
  CatLine line_;
  std::string head_;               // of the next row
  Bytes row_;                      // its bytes
  std::size_t columns_ = 0;        // that they take
  bool full_row_ = false;          // no more go into it
  std::size_t plain_columns_ = 0;  // at the head's begin, which have no colour
  TapeTime before_{};              // of the line before
};

// JSON Lines, data whole (OUTPUT.md).
class JsonCatPrinter final : public CatPrinter {
 public:
  explicit JsonCatPrinter(std::ostream& out) : out_(out) {}
  void begin(const CatLine& line) override;
  void data(ByteView piece) override;
  void end() override;
  void event(const Record& record, TapeTime at) override;

 private:
  [[nodiscard]] std::string of_tape() const;  // `"tape":"laser.log",`, or nothing

  std::ostream& out_;
};

}  // namespace porttape
