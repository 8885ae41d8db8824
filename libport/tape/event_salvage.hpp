#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "libport/tape/event.hpp"
#include "libport/tape/source_window.hpp"
#include "libport/tape/stored_bytes.hpp"

namespace porttape {

struct LostLines {
  std::uint64_t line = 0;  // the first of them
  std::uint64_t lines = 0;
  std::string why;
};

// Finds the sound lines of a damaged events file, before bad ones and behind them, in constant memory. A line
// whose time fits neither those before nor those behind it is bad. Refers to the source.
class EventSalvage {
 public:
  EventSalvage(ByteSource& source, std::uint64_t size) : window_(source), stored_(source), size_(size) {}

  struct Line {
    TapeEvent event;
    std::string text;  // without its newline
    std::uint64_t number = 0;
    bool others_changed = false;  // of an `end`: the lines before it are not those that it tells of
  };
  // What was lost, then the line that follows it. Neither: the end.
  struct Step {
    std::optional<LostLines> lost;
    std::optional<Line> line;
  };
  Result<Step> next();

  // The header's line; known once next() was called. Empty where it was lost.
  [[nodiscard]] const std::string& header_line() const { return header_line_; }

 private:
  Result<bool> read_line();  // into text_; false at the end
  Result<void> fill();
  bool drop_misplaced();
  void lose(std::uint64_t number, std::string why);
  void take_line();

  static constexpr std::size_t kLookAhead = 3;

  SourceWindow window_;
  StoredBytes stored_;
  std::uint64_t size_;
  std::uint64_t offset_ = 0;
  std::uint64_t number_ = 0;
  std::string text_;
  std::string wrong_;  // with the line as such
  std::string header_line_;
  StreamDigest lines_;  // of all before the current one
  std::deque<Line> ahead_;
  std::optional<LostLines> lost_;
  TapeTime last_{};
};

}  // namespace porttape
