#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/stranger_text.hpp"
#include "libport/base/time.hpp"
#include "libport/rules/rule_book.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What a rules file is about on a tape.
struct RulesReport {
  struct Place {
    TapeTime at{};
    std::uint64_t offset = 0;    // in the tape's stream of writes
    std::uint64_t exchange = 0;  // from 1 on
  };
  // How often something was there, and the first time.
  struct Use {
    std::uint64_t count = 0;
    Place first{};
    Bytes frame{};  // the first one
    FrameSpan span{};
  };
  struct Format {
    StrangerText name{};
    std::uint64_t frames = 0;
    std::uint64_t checksum_held = 0;
    std::uint64_t checksum_wrong = 0;
  };
  // The second one is left out where they overlap.
  struct Overlap {
    int one = 0;
    int other = 0;
    Use use{};
  };

  std::vector<Use> rules;    // as in the set
  std::vector<Use> replies;  // answers that are written anew; the frame is the request's
  std::vector<Format> formats;
  std::vector<Overlap> overlaps;
  std::uint64_t frames = 0;
  Use untouched{};  // frames that no rule is about
  Use unframed{};   // bytes that are no frame
  std::uint64_t exchanges = 0;

  // Rules and replies that were never there, or not wholly.
  [[nodiscard]] bool any_trouble() const;
};

// Counts what the rules are about, in a walk over the whole tape: pass() for each record, then finish().
// Refers to the book.
class RulesCheck {
 public:
  explicit RulesCheck(const RuleBook& book);

  void pass(const Record& record);
  [[nodiscard]] RulesReport finish();

 private:
  struct Piece {
    RulesReport::Place place;
    std::size_t size = 0;
  };
  struct Request {
    RulesReport::Place place;
    int format = -1;
    Bytes frame;
  };

  void pass_write(const Record& record);
  void cut_writes(bool ended);
  void count_frame(const RulesReport::Place& place, ByteView frame, int format);
  void end_answer();
  void count_answer(ByteView frame, int format);
  void pass_pieces(std::size_t count);

  const RuleBook& book_;
  RulesReport report_;
  Bytes writes_;  // in no frame yet
  std::deque<Piece> pieces_;
  TapeTime last_{};
  std::vector<Request> requests_;  // of the exchange
  Bytes answer_;
};

}  // namespace porttape
