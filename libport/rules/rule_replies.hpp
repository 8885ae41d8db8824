#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "libport/replay/replies.hpp"
#include "libport/rules/framing.hpp"
#include "libport/rules/rule_book.hpp"

namespace porttape {

// The reply templates of a rules file: pairs the frames that came with those recorded, and writes the
// answers' frames anew from the request before them. An answer that a template may be about comes frame by
// frame, each with its last byte; every other one as it is.
class RuleReplies final : public Replies {
 public:
  explicit RuleReplies(std::shared_ptr<const RuleBook> book);

  void begin() override;
  void asked(const Asked& asked) override;
  [[nodiscard]] Bytes answer(const Read& read) override;
  [[nodiscard]] Bytes rest() override;
  [[nodiscard]] bool keeps() const override { return !kept_.empty(); }

 private:
  // A request: what is recorded and what came.
  struct Pair {
    std::uint64_t end = 0;  // of the recorded one, in the tape's stream
    int format = -1;
    Bytes recorded;
    Bytes came;
  };

  void pair_up(bool ended);
  bool pair_next(bool ended);
  void add(Pair pair);
  [[nodiscard]] const Pair* request_of(std::size_t reply) const;
  [[nodiscard]] bool any_request() const;
  void take_frames(bool ended, Bytes& out);
  [[nodiscard]] Bytes rewritten(ByteView frame, int format) const;

  std::shared_ptr<const RuleBook> book_;
  std::uint64_t begin_ = 0;  // of `recorded_`
  Bytes recorded_;           // in no frame yet
  Bytes came_;
  std::deque<Pair> pairs_;
  std::size_t pair_bytes_ = 0;
  std::uint64_t request_begin_ = 0;  // of the answer that comes now
  std::uint64_t request_end_ = 0;
  Bytes kept_;
};

}  // namespace porttape
