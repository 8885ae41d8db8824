#pragma once

#include <memory>
#include <re2/re2.h>
#include <vector>

#include "libport/rules/filler.hpp"
#include "libport/rules/rule_book.hpp"

namespace porttape {

// The [[redact]] rules of a set with their expressions compiled, and what fills. Never changes. The set must
// be one that read_rules() would give.
class RedactBook {
 public:
  RedactBook(const RuleSet& set, const Filler::Key& key);

  [[nodiscard]] const std::vector<RedactRule>& rules() const { return rules_; }
  [[nodiscard]] const RuleBook& frames() const { return frames_; }
  [[nodiscard]] const Filler& filler() const { return filler_; }

  // Of a rule of the kind place: where in the frame its secret is.
  [[nodiscard]] std::optional<FrameSpan> secret_in(std::size_t rule, int format, ByteView frame) const;

  // Of one of the kinds pattern and text: the first match in bytes[begin, end), whatever stands around them.
  struct Match {
    std::size_t begin = 0;
    std::size_t end = 0;
    FrameSpan secret{};  // may be empty
  };
  [[nodiscard]] std::optional<Match> find(std::size_t rule, ByteView bytes, std::size_t begin,
                                          std::size_t end, bool only_at_begin) const;
  // What a match is shorter than, unless it is cut off.
  [[nodiscard]] std::size_t longest(std::size_t rule) const;

 private:
  using Expression = std::unique_ptr<re2::RE2>;
  struct Compiled {
    Expression when;
    Expression place;  // or the pattern
  };

  std::vector<RedactRule> rules_;
  RuleBook frames_;
  Filler filler_;
  std::vector<Compiled> compiled_;
};

}  // namespace porttape
