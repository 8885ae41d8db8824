#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <re2/re2.h>
#include <string>
#include <utility>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/rules/frame_place.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// A part of a recorded frame that may vary.
struct FrameField {
  enum class Of : std::uint8_t { rule, checksum, length };
  Of of = Of::rule;
  int rule = -1;  // its number in the set
  FrameSpan span{};
};

// What the rules say of one recorded frame.
struct FrameLayout {
  std::vector<FrameField> fields;             // by place; none overlaps another
  std::vector<int> rules;                     // all that are about the frame, in the set's order
  std::vector<std::pair<int, int>> overlaps;  // the second one is left out for the first
  bool varies = false;                        // what comes may be longer or shorter
  bool optional = false;
  std::optional<bool> with_answer{};  // where it is left out
};

// A RuleSet as it is asked, with its expressions compiled. Never changes. The set must be one that
// read_rules() would give: what it would refuse is passed over.
class RuleBook {
 public:
  using Counted = std::vector<Expectation::Memory::Counted>;

  explicit RuleBook(RuleSet set);

  [[nodiscard]] const RuleSet& set() const { return set_; }
  // Null where the frame has none.
  [[nodiscard]] const FrameFormat* format(int number) const {
    return number < 0 ? nullptr : &set_.frames[static_cast<std::size_t>(number)];
  }
  [[nodiscard]] std::size_t longest() const;
  // The shortest pause that ends a frame; the longest time where none does.
  [[nodiscard]] Micros idle() const;

  [[nodiscard]] FrameLayout layout(ByteView frame, int format) const;
  // A frame that may come anywhere: the number of the rule that says so.
  [[nodiscard]] std::optional<int> repeats(ByteView came, int format) const;
  [[nodiscard]] bool any_repeated() const { return any_repeated_; }

  // Whether a frame that came may stand for the recorded one, of the same format.
  struct Judgement {
    bool right = false;
    // Where the difference begins, and what is wrong.
    std::size_t recorded = 0;
    std::size_t came = 0;
    std::string why{};
  };
  // Goes by the counters so far, and brings them up to date where it is right.
  [[nodiscard]] Judgement judge(int format, ByteView recorded, ByteView came, Counted& counted) const;
  // The recorded frame was left out, or one came that the tape has not: counters go on behind it.
  void skip(int format, ByteView recorded, Counted& counted) const;
  void repeat(int format, ByteView came, Counted& counted) const;

  // Of a checksum in a frame of that format, if it has one.
  [[nodiscard]] std::optional<bool> checksum_holds(int format, ByteView frame) const;
  // Writes a frame's length and checksum anew, if `before` (the same frame, as recorded) had them right.
  void mend(int format, ByteView before, Bytes& frame) const;

  struct ReplyPlace {
    const re2::RE2* when = nullptr;
    const re2::RE2* from = nullptr;
    const re2::RE2* answer = nullptr;
    const re2::RE2* to = nullptr;
  };
  [[nodiscard]] ReplyPlace reply(std::size_t number) const;
  // Whether a frame is of that name (empty: any) and has that expression in it (null: any).
  [[nodiscard]] bool fits(ByteView frame, int format, const std::string& name, const re2::RE2* when) const;

 private:
  using Expression = std::unique_ptr<re2::RE2>;
  struct Compiled {
    Expression when;
    Expression place;
    Expression regex;
  };
  struct CompiledReply {
    Expression when;
    Expression from;
    Expression answer;
    Expression to;
  };

  [[nodiscard]] std::optional<FrameSpan> span_of(const FrameField& field, int format, ByteView frame) const;
  void add_derived(ByteView frame, int format, FrameLayout& layout) const;
  [[nodiscard]] std::string wrong_with(const FrameField& field, int format, ByteView recorded, ByteView came,
                                       ByteView whole, Counted& counted) const;
  [[nodiscard]] std::string wrong_value(int rule, ByteView recorded, ByteView came, Counted& counted) const;
  [[nodiscard]] std::string wrong_count(int rule, ByteView recorded, ByteView came, Counted& counted) const;

  RuleSet set_;
  std::vector<Compiled> rules_;
  std::vector<CompiledReply> replies_;
  bool any_repeated_ = false;
};

// "rule 'time' (gpsd.rules:12)"
std::string name_of(const RuleSet& set, const Rule& rule);

}  // namespace porttape
