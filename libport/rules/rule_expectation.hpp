#pragma once

#include <memory>

#include "libport/replay/expectation.hpp"
#include "libport/rules/framing.hpp"
#include "libport/rules/rule_book.hpp"

namespace porttape {

// What a rules file lets vary. Recorded writes are cut into frames; a frame that no rule is about is compared
// byte by byte, and so is what is no frame. Where all that may vary keeps its length, what came is held
// against the frame as it comes, and what varies is judged at the frame's end; else the frame that came is
// judged whole.
class RuleExpectation final : public Expectation {
 public:
  explicit RuleExpectation(RuleSet set) : book_(std::make_shared<const RuleBook>(std::move(set))) {}

  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory& memory) const override;
  [[nodiscard]] Held hold_beyond(ByteView came, Memory& memory) const override;
  [[nodiscard]] Reach reach() const override;
  [[nodiscard]] std::unique_ptr<Replies> replies() const override;
  [[nodiscard]] bool leaves_out() const override;

  [[nodiscard]] const RuleBook& book() const { return *book_; }

 private:
  void begin_frame(const Stretch& recorded, Memory& memory) const;
  [[nodiscard]] bool repeats(int format, const Memory& memory) const;
  [[nodiscard]] Held hold_in_place(const Stretch& recorded, ByteView came, const FrameLayout& layout,
                                   Memory& memory) const;
  [[nodiscard]] Held hold_whole(const Stretch& recorded, ByteView came, const FrameLayout& layout,
                                Memory& memory) const;
  [[nodiscard]] Held without_bytes(const Stretch& recorded, const FrameLayout& layout, Memory& memory) const;
  [[nodiscard]] Held judge_whole(const Stretch& recorded, const FrameLayout& layout, std::size_t used,
                                 int format, Memory& memory) const;
  [[nodiscard]] FrameCut cut_of(ByteView came, const Memory& memory, bool ended) const;

  std::shared_ptr<const RuleBook> book_;
};

}  // namespace porttape
