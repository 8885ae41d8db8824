#include "libport/replay/cause.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "libport/replay/context.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/report_words.hpp"
#include "libport/replay/request_cause.hpp"

namespace porttape {
namespace {

using Kind = Cause::Kind;

// Within which no driver runs out of patience: 20 ms, and where the tape's had waited longer up to 100 ms.
constexpr Micros kSoon{20'000};
constexpr Micros kMostSoon{100'000};
constexpr Micros kLongWait{200'000};  // after which one may have

// What a report and the tape around its fault show.
class Analysis {
 public:
  Analysis(const RunReport& report, const TapeExcerpt& excerpt)
      : report_(report), excerpt_(excerpt), roles_(roles_of(report.writer)), place_(excerpt.place) {}

  [[nodiscard]] std::optional<Cause> cause() const {
    switch (report_.verdict) {
      case Verdict::data_mismatch:
      case Verdict::extra:
        return report_.mismatch ? data() : std::nullopt;
      case Verdict::timing_mismatch:
        return report_.mismatch && on_tape() ? std::optional(timing()) : std::nullopt;
      case Verdict::incomplete:
        return report_.next_expected.empty() || !on_tape() ? std::nullopt : std::optional(unsent());
      case Verdict::pass:
      case Verdict::settings_mismatch:
        break;
    }
    return std::nullopt;
  }

 private:
  [[nodiscard]] bool on_tape() const { return place_ < excerpt_.steps.size(); }
  [[nodiscard]] const TapeFrame& frame() const { return excerpt_.steps[place_].frame; }
  [[nodiscard]] std::string name(std::size_t step) const { return frame_name(excerpt_, step, roles_); }
  [[nodiscard]] Cause make(Kind kind, bool certain, std::string text) const {
    return {kind, certain, std::move(text), frame().exchange};
  }
  [[nodiscard]] std::string one() const { return std::string(roles_.one); }

  // What is between the place and the frame before it: null, where the tape has no answer there.
  [[nodiscard]] const TapeAnswer* answer_before() const {
    if (place_ == 0) return nullptr;
    const std::optional<TapeAnswer>& answer = excerpt_.steps[place_ - 1].answer;
    return answer ? &*answer : nullptr;
  }
  // "the answer to request 3"
  [[nodiscard]] std::string answer_name() const {
    return "the " + std::string(roles_.answer) + (report_.writer == Writer::driver ? " to " : " before ") +
           (report_.writer == Writer::driver ? name(place_ - 1) : name(place_));
  }
  // "0 of 20 bytes"
  [[nodiscard]] static std::string share(std::uint64_t part, std::uint64_t whole) {
    return std::to_string(part) + " of " + counted(whole, "byte");
  }

  // Where rules say what may vary, only a frame that the tape has elsewhere, byte by byte, tells more than
  // they.
  [[nodiscard]] static bool is_of_whole_frames(Kind kind) {
    return kind == Kind::left_out || kind == Kind::swapped || kind == Kind::early || kind == Kind::twice ||
           kind == Kind::again || kind == Kind::at_end;
  }

  [[nodiscard]] std::optional<Cause> data() const {
    const Bytes came = came_from_frame(report_, excerpt_);
    if (came.empty()) return std::nullopt;
    Cause cause = request_cause(excerpt_, cut_came(excerpt_, came), report_.mismatch->answered, roles_);
    if (report_.ruled && !is_of_whole_frames(cause.kind)) return std::nullopt;
    const TapeAnswer* const answer = answer_before();
    if (answer == nullptr || report_.lookup) return cause;
    const std::uint64_t there = delivered_of(report_, *answer);
    if (there < answer->length) {
      cause.text += ", before " + answer_name() + " had come (" + share(there, answer->length) + ')';
    }
    return cause;
  }

  [[nodiscard]] Cause unsent() const {
    if (!report_.next_expected_before.empty()) return cut_short();
    const TapeAnswer* const answer = answer_before();
    const std::string never = name(place_) + ' ' + bytes_text(frame().bytes) + " never came";
    if (answer == nullptr) return without_answer(never);
    const std::uint64_t there = delivered_of(report_, *answer);
    const std::string in_full =
        answer_name() + ", which came in full (" + counted(answer->length, "byte") + ')';
    if (there < answer->length) return gave_up(share(there, answer->length), there == 0, never);
    if (report_.hung) {
      return make(Kind::hung, false,
                  one() + " hung after " + in_full + ": looks like it waits for more than that; " + never);
    }
    const bool failed = report_.command_exit.value_or(0) != 0;
    if (!failed && excerpt_.to_end && place_ + 1 == excerpt_.steps.size())
      return make(Kind::left_out, true, name(place_) + ", the last, left out: it ended after " + in_full);
    const std::string unread = report_.left_unread.value_or(0) > 0
                                   ? " and left " + share(*report_.left_unread, answer->length) + " unread"
                                   : "";
    if (unread.empty() && report_.idle >= std::max(kLongWait, 10 * recorded_gap())) {
      return make(Kind::stopped, false,
                  one() + " stopped " + millis_text(report_.idle) + " after " + in_full +
                      ": looks like it waited for more than that; " + never);
    }
    return make(Kind::stopped, true, one() + " stopped after " + in_full + unread + ": " + never);
  }

  // It ended and still had an answer to come.
  [[nodiscard]] Cause gave_up(const std::string& came, bool nothing_came, const std::string& never) const {
    const std::string when = (report_.hung ? " was ended " : " gave up ") + millis_text(report_.idle);
    const std::string before = ", before " + answer_name() + " had come (" + came + ')';
    if (nothing_came && !report_.hung && report_.idle < soon()) {
      return make(Kind::gave_up, false,
                  one() + when + " after " + name(place_ - 1) + before +
                      ": looks like it took unread bytes of an answer before for it, or did not wait; " +
                      never);
    }
    return make(Kind::gave_up, true, one() + when + " after the last byte" + before + ": " + never);
  }

  [[nodiscard]] Micros soon() const {
    const TapeAnswer* const answer = answer_before();
    if (answer == nullptr || place_ == 0) return kSoon;
    const Micros waited = answer->begun - excerpt_.steps[place_ - 1].frame.at;
    return std::clamp(std::chrono::duration_cast<Micros>(waited / report_.rate), kSoon, kMostSoon);
  }

  [[nodiscard]] Cause without_answer(const std::string& never) const {
    const std::string first = report_.playback.loops > 1
                                  ? "the first " + std::string(roles_.request) + " of loop " +
                                        std::to_string(report_.playback.loops)
                                  : "its first " + std::string(roles_.request);
    const std::string after = place_ == 0 ? " before " + first : " after " + name(place_ - 1);
    const std::string what = report_.hung ? " hung" : " stopped";
    return make(report_.hung ? Kind::hung : Kind::stopped, true, one() + what + after + ": " + never);
  }

  // Of the request that began, the rest never came.
  [[nodiscard]] Cause cut_short() const {
    const std::uint64_t sent =
        report_.next_expected_offset - std::min(report_.next_expected_offset, frame().offset);
    const auto head = static_cast<std::size_t>(std::min<std::uint64_t>(sent, frame().bytes.size()));
    const ByteView rest = ByteView(frame().bytes).subspan(head);
    const bool line_end = !rest.empty() && std::ranges::all_of(rest, is_line_end);
    const std::string waits = excerpt_.steps[place_].answer ? ", without which the tape does not go on" : "";
    if (line_end) {
      return make(Kind::terminator, true,
                  "terminator missing: " + name(place_) + " came without its " + named_bytes(rest) + waits);
    }
    const std::uint64_t missing = frame().length - head;
    return make(Kind::cut_short, true,
                name(place_) + " cut short: " + number_word(missing) + (missing == 1 ? " byte" : " bytes") +
                    " less, the last: the tape has " + named_bytes(rest) + at_byte(head) + waits);
  }

  [[nodiscard]] static std::string at_byte(std::size_t at) { return " at byte " + std::to_string(at); }

  // The time between what came before the write on the tape and the write.
  [[nodiscard]] Micros recorded_gap() const {
    const TapeAnswer* const answer = answer_before();
    if (answer != nullptr) return frame().at - answer->at;
    return place_ > 0 ? frame().at - excerpt_.steps[place_ - 1].frame.at : frame().at - TapeTime{};
  }

  [[nodiscard]] std::string after_what() const {
    if (answer_before() != nullptr) return " after " + answer_name();
    return place_ > 0 ? " after " + name(place_ - 1) : " after " + std::string(roles_.open);
  }

  [[nodiscard]] Cause timing() const {
    const Mismatch& mismatch = *report_.mismatch;
    const bool late = mismatch.error.count() > 0;
    const std::string which = name(place_);
    if (late && mismatch.own_late * 2 > mismatch.error) {
      return make(Kind::own_lateness, false,
                  "looks like this machine, not " + one() + ": what came before " + which +
                      " was delivered " + millis_text(mismatch.own_late) + " late");
    }
    if (report_.timing == Timing::recorded) {
      return make(late ? Kind::late : Kind::too_soon, true,
                  which + (late ? " came late: " : " came too soon: ") +
                      millis_text(late ? mismatch.error : -mismatch.error) + (late ? " behind" : " before") +
                      " the tape's clock");
    }
    const auto recorded = std::chrono::duration_cast<Micros>(recorded_gap() / report_.rate);
    const Micros real = recorded + mismatch.error;
    const std::string on_tape = ", on the tape " + millis_text(recorded);
    if (late)
      return make(Kind::late, true, which + " came late: " + millis_text(real) + after_what() + on_tape);
    if (real.count() < 0 && answer_before() != nullptr) {
      return make(Kind::not_awaited, true,
                  which + " did not wait for " + answer_name() + ": it came " + millis_text(-real) +
                      " before the last of its " + counted(answer_before()->length, "byte") + on_tape +
                      " after it");
    }
    const Micros least = std::max(real, Micros{0});
    return make(Kind::too_soon, true,
                which + " came too soon: " + millis_text(least) + after_what() + on_tape);
  }

  const RunReport& report_;
  const TapeExcerpt& excerpt_;
  Roles roles_;
  std::size_t place_;
};

// Nothing is wrong with the bytes, and the command says that something is.
std::optional<Cause> command_cause(const RunReport& report) {
  const std::uint64_t unread = report.left_unread.value_or(0);
  if (unread == 0) return std::nullopt;
  return Cause{Kind::unread, true,
               "bytes unread: " + std::string(roles_of(report.writer).one) + " closed with " +
                   counted(unread, "byte") + " of what it was answered unread"};
}

// Where bytes came otherwise cut than recorded, that may be all.
Cause with_read_sizes(std::optional<Cause> cause, const std::string& chunks) {
  std::string text =
      "looks like a parser that depends on read sizes: the answers came cut otherwise than recorded "
      "(--chunks " +
      chunks + ')';
  if (cause) text += "; what it did then: " + cause->text;
  return {Kind::read_sizes, false, std::move(text), cause ? cause->request : std::nullopt};
}

}  // namespace

std::string_view to_string(Cause::Kind kind) {
  constexpr std::array<std::string_view, 24> kNames = {
      "left-out",     "swapped",     "early",    "twice",      "again",   "terminator",      "byte-more",
      "byte-less",    "letter-case", "checksum", "off-by-one", "changed", "unknown-request", "at-end",
      "cut-short",    "stopped",     "hung",     "gave-up",    "late",    "too-soon",        "not-awaited",
      "own-lateness", "read-sizes",  "unread"};
  return kNames.at(static_cast<std::size_t>(kind));
}

std::optional<Cause> find_cause(const RunReport& report) {
  if (report.trouble || report.verdict == Verdict::settings_mismatch) return std::nullopt;
  const bool failed = report.verdict != Verdict::pass || report.command_exit.value_or(0) != 0;
  if (!failed) return std::nullopt;
  std::optional<Cause> cause;
  if (report.excerpt) cause = Analysis(report, *report.excerpt).cause();
  if (report.verdict == Verdict::pass) cause = command_cause(report);
  const bool by_cuts =
      !report.chunks.empty() && report.delivered > 0 && report.verdict != Verdict::timing_mismatch;
  return by_cuts ? with_read_sizes(std::move(cause), report.chunks) : cause;
}

}  // namespace porttape
