#pragma once

#include <cstdint>
#include <ostream>
#include <string>

#include "libport/tape/new_file.hpp"
#include "tools/diff_words.hpp"

namespace porttape {

// The two tapes of a comparison and what was asked for.
struct DiffTitle {
  std::string one;  // their names
  std::string other;
  std::optional<Micros> margin;
};

// Shows a comparison: begin(), each difference in order, end(). Keeps references to what it is made with.
class DiffPrinter {
 public:
  virtual ~DiffPrinter() = default;
  virtual Result<void> begin(const DiffTitle& title, const TapeDiff& diff) = 0;
  virtual Result<void> difference(const ShownDifference& difference) = 0;
  // `more`: differences that were left out.
  virtual Result<void> end(std::uint64_t more) = 0;
};

// For people.
class TextDiffPrinter final : public DiffPrinter {
 public:
  TextDiffPrinter(std::ostream& out, bool colors, std::size_t width)
      : out_(out), colors_(colors), width_(width) {}
  Result<void> begin(const DiffTitle& title, const TapeDiff& diff) override;
  Result<void> difference(const ShownDifference& difference) override;
  Result<void> end(std::uint64_t more) override;

 private:
  void print(const DifferenceLine& line);

  std::ostream& out_;
  bool colors_;
  std::size_t width_;
};

// JSON Lines (OUTPUT.md).
class JsonDiffPrinter final : public DiffPrinter {
 public:
  explicit JsonDiffPrinter(std::ostream& out) : out_(out) {}
  Result<void> begin(const DiffTitle& title, const TapeDiff& diff) override;
  Result<void> difference(const ShownDifference& difference) override;
  Result<void> end(std::uint64_t more) override;

 private:
  std::ostream& out_;
};

// A page that needs nothing else.
class HtmlDiffPrinter final : public DiffPrinter {
 public:
  explicit HtmlDiffPrinter(NewFile& file) : file_(file) {}
  Result<void> begin(const DiffTitle& title, const TapeDiff& diff) override;
  Result<void> difference(const ShownDifference& difference) override;
  Result<void> end(std::uint64_t more) override;

 private:
  NewFile& file_;
  bool listing_ = false;
};

}  // namespace porttape
