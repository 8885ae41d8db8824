#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/formats/log_time.hpp"
#include "libport/tape/record.hpp"

namespace re2 {
class RE2;
}

namespace porttape {

// How a kind of text log is read: a TOML file, as FORMATS.md says. Immutable.
class Dialect {
 public:
  enum class Coding : std::uint8_t { hex, decimal, escaped, text, bracketed };

  // Errc::usage: what is wrong in it, by line.
  static Result<Dialect> parse(const std::string& toml, const std::string& file);

  struct Found {
    enum class What : std::uint8_t { bytes, nothing, unknown, damaged };
    What what = What::unknown;
    std::optional<Direction> direction;
    std::optional<std::string_view> time;
    Bytes bytes;
    bool goes_on = false;  // a row as long as rows get: the next one may be more of it
  };
  // A line without colours. The time refers to it.
  [[nodiscard]] Found find(std::string_view line) const;

  [[nodiscard]] LogUnit unit() const { return unit_; }
  [[nodiscard]] bool is_detected() const { return detected_; }
  [[nodiscard]] const std::vector<std::string>& guesses() const { return guesses_; }

 private:
  struct Pattern {
    std::shared_ptr<const re2::RE2> expression;
    Coding coding = Coding::hex;
    std::optional<Direction> direction;
    Bytes end;
    std::size_t row = 0;
    int bytes_group = 0;
    int time_group = 0;       // 0: it has none
    int direction_group = 0;  // 0: it has none
  };
  friend class DialectReader;
  [[nodiscard]] std::optional<Direction> direction_of(std::string_view word) const;

  std::vector<Pattern> patterns_;
  std::vector<std::shared_ptr<const re2::RE2>> skips_;
  std::vector<std::string> writes_;
  std::vector<std::string> reads_;
  std::vector<std::string> guesses_;
  LogUnit unit_ = LogUnit::seconds;
  bool detected_ = true;
};

// The bytes that a text says; nothing: it is wrong.
std::optional<Bytes> bytes_in(std::string_view text, Dialect::Coding coding);

// What a terminal obeys is taken out: colours, carriage returns.
std::string without_colors(std::string_view line);

}  // namespace porttape
