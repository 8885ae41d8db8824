// Any text as a rules file, and any bytes under it: no crash, errors that a user can act on; what was
// understood can be written down and understood again; the same is accepted and the same answered however
// tape, driver and answers are cut, and hold() goes by its arguments alone; the same is redacted however it
// is cut, and as long.

#include <optional>
#include <string>
#include <string_view>

#include "libport/replay/matcher.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/rules/redact_stream.hpp"
#include "libport/rules/rule_expectation.hpp"
#include "libport/rules/rules_check.hpp"
#include "libport/rules/rules_reader.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/usage_error.hpp"
#include "tests/support/memory_tape.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

constexpr std::size_t kMostBytes = 400;

class AskedTwice final : public Expectation {
 public:
  explicit AskedTwice(const RuleExpectation& rules) : rules_(rules) {}

  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory& memory) const override {
    Memory again = memory;
    const Held held = rules_.hold(recorded, came, memory);
    require(rules_.hold(recorded, came, again) == held && again == memory, "hold() goes by its arguments");
    require(held.recorded <= recorded.bytes.size() && held.came <= came.size(), "it uses what there is");
    require(memory.frame.size() <= kMostBytes && memory.came.size() <= kMostBytes, "memory is bounded");
    return held;
  }
  [[nodiscard]] Held hold_beyond(ByteView came, Memory& memory) const override {
    return rules_.hold_beyond(came, memory);
  }
  [[nodiscard]] Reach reach() const override { return rules_.reach(); }

 private:
  const RuleExpectation& rules_;
};

struct Told {
  bool mismatch = false;
  std::uint64_t offset = 0;
  std::optional<bool> unsent{};
  friend bool operator==(const Told&, const Told&) = default;
};

Told end(Matcher& matcher, Matcher::Outcome outcome, std::string_view rest) {
  if (outcome == Matcher::Outcome::differs || outcome == Matcher::Outcome::extra)
    return {true, matcher.describe(as_bytes(rest)).offset, {}};
  return {false, 0, matcher.any_unsent()};
}

Told compared(const MemoryTape& tape, const Expectation& rules, std::string_view text, std::size_t cut,
              std::size_t piece) {
  MemorySource source(tape, MemorySource::Select::writes_only, piece);
  Budget budget;
  const ReplayClock clock(1);
  Matcher matcher(source, budget, clock, Micros{500}, &rules);
  matcher.rewind();
  std::size_t used = 0;
  while (used < text.size() || matcher.goes_on()) {
    budget.refill();
    const std::string_view part = text.substr(used, cut);
    const Matcher::Step step = matcher.write(Instant{}, as_bytes(part));
    used += step.used;
    if (step.outcome == Matcher::Outcome::differs || step.outcome == Matcher::Outcome::extra)
      return end(matcher, step.outcome, text.substr(used, cut));
  }
  while (matcher.pause_due()) {
    budget.refill();
    const Matcher::Outcome outcome = matcher.pause().outcome;
    if (outcome != Matcher::Outcome::block) {
      if (outcome != Matcher::Outcome::taken) return end(matcher, outcome, {});
      break;
    }
  }
  budget.refill();
  return end(matcher, matcher.end_session().outcome, {});
}

std::string answered(const Expectation& rules, std::string_view recorded, std::string_view came,
                     std::string_view answer, std::size_t cut) {
  const std::unique_ptr<Replies> replies = rules.replies();
  if (!replies) return {};
  replies->begin();
  replies->asked({0, as_bytes(recorded), as_bytes(came)});
  std::string out;
  for (std::size_t at = 0; at < answer.size(); at += cut)
    out += as_text(replies->answer({as_bytes(answer.substr(at, cut)), at, recorded.size()}));
  return out + std::string(as_text(replies->rest()));
}

std::string_view take_part(std::string_view& rest, std::size_t most) {
  const std::string_view part = rest.substr(0, rest.find('\f'));
  rest.remove_prefix(std::min(rest.size(), part.size() + 1));
  return part.substr(0, most);
}

// Blocks end at a vertical tab.
MemoryTape tape_of(std::string_view text, std::string& all) {
  MemoryTape tape;
  for (std::int64_t us = 0; !text.empty(); us += 1000) {
    const std::string_view block = text.substr(0, text.find('\v'));
    text.remove_prefix(std::min(text.size(), block.size() + 1));
    if (!block.empty()) tape.write(us, block);
    all += block;
  }
  return tape;
}

void count(const RuleBook& book, const MemoryTape& tape) {
  MemorySource source(tape);
  RulesCheck check(book);
  while (true) {
    const auto record = source.next();
    if (!record || !*record) break;
    check.pass(**record);
  }
  (void)check.finish();
}

// What comes of a text cut so, or why nothing does.
std::string redacted(const RedactBook& book, RedactStream::Of of, std::string_view text, std::size_t cut) {
  RedactStream stream(book, of);
  for (std::size_t at = 0; at < text.size(); at += cut) {
    if (const Result<void> added = stream.add(as_bytes(text.substr(at, cut))); !added)
      return added.error().message;
  }
  if (const Result<void> done = stream.finish(); !done) return done.error().message;
  const RedactStream::Ready ready = stream.take();
  require(ready.bytes.size() == text.size(), "what is redacted is as long");
  for (const Redaction& each : ready.redactions)
    require(each.length > 0 && each.offset + each.length <= text.size(), "what is replaced is of the stream");
  return std::string(as_text(ready.bytes));
}

void redact(const RuleSet& rules, std::string_view text, std::size_t cut) {
  const RedactBook book(rules, {1, 2});
  for (const auto of : {RedactStream::Of::reads, RedactStream::Of::writes, RedactStream::Of::text}) {
    require(redacted(book, of, text, cut) == redacted(book, of, text, text.size() + 1),
            "the same is redacted however it is cut");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  const std::size_t cut = 1 + input(7);
  const std::size_t piece = 1 + input(7);
  std::string_view rest = input.rest();
  Result<RuleSet> rules = read_rules(take_part(rest, rest.size()), "my.rules");
  if (!rules) {
    require_usage(rules.error());
    return 0;
  }
  const Result<RuleSet> again = read_rules(to_toml(*rules), "my.rules");
  require(again && *again == *rules, "rules are understood as they were written down");
  for (FrameFormat& format : rules->frames) format.longest = std::min<std::size_t>(format.longest, 128);
  const RuleExpectation expectation(*rules);
  const AskedTwice asked(expectation);
  std::string recorded;
  const MemoryTape tape = tape_of(take_part(rest, kMostBytes / 2), recorded);
  const std::string_view came = take_part(rest, kMostBytes / 2);
  const std::string_view answer = take_part(rest, kMostBytes / 2);
  require(compared(tape, asked, came, cut, piece) == compared(tape, asked, came, came.size() + 1, 1000),
          "the same is accepted however it is cut");
  const bool pauses = expectation.book().idle() != Micros::max();  // there are none here
  require(pauses || compared(tape, asked, recorded, cut, piece) == Told{false, 0, false},
          "what is on the tape is accepted");
  require(answered(expectation, recorded, came, answer, cut) ==
              answered(expectation, recorded, came, answer, answer.size() + 1),
          "the same is answered however it is cut");
  count(expectation.book(), tape);
  redact(*rules, came, cut);
  return 0;
}
