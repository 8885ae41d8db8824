#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/error.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What was asked on a tape, and where each answer stands. A request is the run of writes between two answers
// (reads, or the device's end of its line or sending); an answer is all that the device did until the next
// write, close or open. Equal requests are of one kind; with an expectation, those too that may come in place
// of each other.
//
// Drive it: read_on() until it is true or error() is set; all else is about what it has read then. Each
// distinct request is kept once, and of each exchange where its answer is: at most kMostBytes in all, beyond
// which it is an error. Refers to its source, budget and expectation, which must outlive it.
class RequestIndex {
 public:
  static constexpr std::size_t kMostBytes = std::size_t{64} << 20;
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  enum class End : std::uint8_t { none, hang_up, half_close };

  // A request, as it stands on the tape, and its answer.
  struct Exchange {
    std::uint64_t file_offset = 0;  // of the answer's first block
    std::uint64_t reads = 0;        // bytes of reads before the answer
    std::uint64_t writes = 0;       // bytes of writes before the request
    std::uint64_t answer_size = 0;  // bytes
    TapeTime began{};               // when the request's first write was
    TapeTime asked{};               // and its last: what the answer is timed from
    TapeTime ended{};               // when the device ended its line or sending
    std::uint32_t text = 0;
    std::uint32_t next = kNone;  // the next one of its kind
    End end = End::none;         // behind the answer
  };
  // Requests that are answered in turn.
  struct Kind {
    std::uint32_t first = kNone;  // exchange
    std::uint32_t last = kNone;
  };

  // `expectation`: null where only equal requests are of one kind.
  RequestIndex(RecordSource& tape, Budget& budget, const Expectation* expectation,
               std::size_t most_bytes = kMostBytes)
      : tape_(tape), budget_(budget), expectation_(expectation), most_bytes_(most_bytes) {}

  // Whether all is read; reads on as far as the budget goes.
  [[nodiscard]] bool read_on();
  [[nodiscard]] bool whole() const { return whole_; }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }

  [[nodiscard]] std::uint32_t exchanges() const { return static_cast<std::uint32_t>(exchanges_.size()); }
  [[nodiscard]] const Exchange& exchange(std::uint32_t at) const { return exchanges_[at]; }
  // The exchange whose request has the byte at this place of the tape's writes, or the next one.
  [[nodiscard]] std::uint32_t exchange_at(std::uint64_t writes) const;
  [[nodiscard]] std::uint32_t kinds() const { return static_cast<std::uint32_t>(kinds_.size()); }
  [[nodiscard]] const Kind& kind(std::uint32_t at) const { return kinds_[at]; }
  // The bytes of an exchange's request.
  [[nodiscard]] ByteView request(std::uint32_t exchange) const {
    return texts_[exchanges_[exchange].text].bytes;
  }
  // What of them is behind the first `used`, to the end of their block, as an expectation is asked.
  [[nodiscard]] Expectation::Stretch stretch(std::uint32_t exchange, std::size_t used) const;

  // Without an expectation: the kinds by the bytes of their requests, and those bytes.
  [[nodiscard]] const std::vector<std::uint32_t>& sorted() const { return sorted_; }
  [[nodiscard]] ByteView kind_request(std::uint32_t kind) const { return request(kinds_[kind].first); }

  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  struct Block {
    std::uint32_t end = 0;  // in the request
    TapeTime at{};
  };
  struct Text {
    ByteView bytes;
    std::uint32_t kind = 0;
    std::vector<Block> blocks;  // where there are several
  };

  void take(const Record& record);
  void take_write(const Record& record);
  void take_read(const Record& record);
  void take_end(const Record& record, End end);
  void end_question();
  void end_session();
  std::uint32_t intern();
  std::uint32_t kind_of(std::uint32_t text);
  [[nodiscard]] bool may_come_for(std::uint32_t exchange, ByteView came);
  ByteView keep(ByteView bytes);
  void add_bytes(std::size_t count, TapeTime at);
  void sort();

  RecordSource& tape_;
  Budget& budget_;
  const Expectation* expectation_;
  std::size_t most_bytes_;
  bool begun_ = false;
  bool whole_ = false;
  std::optional<Error> error_;

  std::deque<Exchange> exchanges_;
  std::deque<Text> texts_;
  std::vector<Kind> kinds_;
  std::unordered_multimap<std::size_t, std::uint32_t> by_hash_;  // texts
  std::vector<std::uint32_t> sorted_;
  std::vector<std::unique_ptr<Byte[]>> chunks_;  // what the texts lie in
  std::size_t chunk_left_ = 0;
  std::size_t bytes_ = 0;

  // Of the question that the reading is in.
  Bytes question_;
  std::vector<Block> blocks_;
  Exchange asked_{};
  bool answering_ = false;  // the last exchange's answer is being read
  bool line_closed_ = false;
  std::uint64_t reads_ = 0;
  std::uint64_t writes_ = 0;
};

}  // namespace porttape
