#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/tape/exchange_count.hpp"
#include "libport/tape/quantiles.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// A picture of a tape: give it the tape's records, in order; svg() draws what came. Constant memory, whatever
// the tape's length: bytes are summed in at most kMostColumns columns of equal time, which become wider as it
// goes on.
class TapePlot {
 public:
  void add(const Record& record);

  // A standalone picture in SVG, light or dark as its viewer is; `name` and `notes` (damage) stand in it.
  [[nodiscard]] std::string svg(std::string_view name, const std::vector<std::string>& notes) const;

 private:
  static constexpr std::size_t kMostColumns = 2048;
  static constexpr std::size_t kMostEvents = 400;
  static constexpr std::size_t kBinsADecade = 10;
  static constexpr std::size_t kBins = 9 * kBinsADecade;  // 1 us to 1000 s

  struct Column {
    std::uint64_t read = 0;
    std::uint64_t write = 0;
  };
  struct Sign {
    TapeTime at{};
    TapeTime from{};  // of a gap
    std::string_view look;
    std::string text;
  };
  struct Picture;

  void add_block(const Record& record);
  void add_event(const Record& record);
  Column& column_of(TapeTime at);

  std::vector<Column> columns_;
  std::int64_t column_us_ = 1;
  std::vector<Sign> signs_;
  std::uint64_t more_signs_ = 0;  // that are not kept
  std::array<std::uint64_t, kBins> latencies_{};
  Quantiles latency_;
  std::int64_t end_us_ = 0;
  ExchangeCount exchanges_;
  std::array<std::uint64_t, 2> blocks_{};  // read, write
  std::array<std::uint64_t, 2> bytes_{};
  std::int64_t asked_us_ = 0;  // the last write
};

}  // namespace porttape
