#pragma once

#include <cstdint>
#include <ostream>

#include "libport/base/bytes.hpp"
#include "libport/tape/record.hpp"

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
  virtual void begin(const CatLine& line) = 0;
  virtual void data(ByteView piece) = 0;
  virtual void end() = 0;
  virtual void event(const Record& record) = 0;
};

// For people: time, direction, length, text and hex; of long data the first bytes only.
class TextCatPrinter final : public CatPrinter {
 public:
  static constexpr std::size_t kShown = 32;

  TextCatPrinter(std::ostream& out, bool color) : out_(out), color_(color) {}
  void begin(const CatLine& line) override;
  void data(ByteView piece) override;
  void end() override;
  void event(const Record& record) override;

 private:
  std::ostream& out_;
  bool color_;
  CatLine line_;
  Bytes shown_;
};

// JSON Lines, data whole (OUTPUT.md).
class JsonCatPrinter final : public CatPrinter {
 public:
  explicit JsonCatPrinter(std::ostream& out) : out_(out) {}
  void begin(const CatLine& line) override;
  void data(ByteView piece) override;
  void end() override;
  void event(const Record& record) override;

 private:
  std::ostream& out_;
};

}  // namespace porttape
