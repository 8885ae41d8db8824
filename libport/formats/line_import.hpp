#pragma once

#include <optional>
#include <string_view>

#include "libport/formats/format.hpp"
#include "libport/formats/spilled_bytes.hpp"

namespace porttape {

// What importers of text share: its lines one after the other, a block whose bytes stand on several of them,
// and errors that tell their place. Refers to the evidence and the tape.
class LineImport {
 public:
  LineImport(const LineImport&) = delete;
  LineImport& operator=(const LineImport&) = delete;

  // As an ImportFunction.
  Result<std::optional<TapeTime>> run(const ConvertProgress& progress);

 protected:
  LineImport(Evidence& from, ImportTape& to) : from_(from), to_(to) {}
  ~LineImport() = default;

  virtual Result<void> take_line() = 0;  // line()
  virtual Result<void> at_end() { return put_block(); }

  [[nodiscard]] const Evidence& evidence() const { return from_; }
  [[nodiscard]] const Evidence::Line& line() const { return line_; }
  ImportTape& tape() { return to_; }

  [[nodiscard]] Error wrong(std::size_t column, std::string_view what) const {
    return from_.error_at(line_, column, what);
  }
  // What the tape does not take is wrong at that column.
  [[nodiscard]] Result<void> placed(Result<void> put, std::size_t column = 0) const;

  // Before each record: the block before is whole, and there is no end yet.
  Result<void> begin_record();
  void end_at(TapeTime end) { end_ = end; }
  Result<void> take_header(std::string_view header, std::size_t column);
  // An event's object; without a time at its own.
  Result<void> take_event(std::optional<TapeTime> at, std::string_view object, std::size_t column);

  // A block of less than 4 GiB, in constant memory.
  void begin_block(Direction direction, TapeTime at);
  [[nodiscard]] bool in_block() const { return block_.has_value(); }
  Result<void> add_to_block(ByteView bytes, std::size_t column);
  Result<void> put_block();

 private:
  struct Block {
    Direction direction;
    TapeTime at;
    std::uint64_t line;
  };
  Result<void> put_data(const Block& block);

  Evidence& from_;
  ImportTape& to_;
  Evidence::Line line_;
  std::optional<Block> block_;
  SpilledBytes data_;  // of it
  std::optional<TapeTime> end_;
};

}  // namespace porttape
