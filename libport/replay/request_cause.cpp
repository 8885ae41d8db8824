#include "libport/replay/request_cause.hpp"

#include <algorithm>

#include "libport/replay/edit_cause.hpp"
#include "libport/replay/report_words.hpp"

namespace porttape {
namespace {

using Kind = Cause::Kind;

ByteView body_of(ByteView frame) {
  while (!frame.empty() && is_line_end(frame.back())) frame = frame.first(frame.size() - 1);
  return frame;
}

bool starts_with(ByteView bytes, ByteView beginning) {
  return bytes.size() >= beginning.size() && std::ranges::equal(bytes.first(beginning.size()), beginning);
}

// The frames that came, held against those of the tape.
class Requests {
 public:
  Requests(const TapeExcerpt& excerpt, const std::vector<CameFrame>& came, bool answered, const Roles& roles)
      : excerpt_(excerpt), came_(came), answered_(answered), roles_(roles), place_(excerpt.place) {}

  [[nodiscard]] Cause cause() const {
    if (auto cause = missing_line_end()) return *cause;
    std::vector<Cause> found;
    if (auto cause = later_request()) found.push_back(std::move(*cause));
    if (auto cause = earlier_request()) found.push_back(std::move(*cause));
    if (found.size() == 2 && found.front().certain != found.back().certain)
      return found.front().certain ? found.front() : found.back();
    if (found.size() == 2) return either(found.front(), found.back());
    if (!found.empty()) return found.front();
    if (auto cause = broken_later_request()) return *cause;
    if (place_ == excerpt_.steps.size()) return at_end();
    if (is(1, place_)) return added();
    return another();
  }

 private:
  [[nodiscard]] const TapeFrame& frame(std::size_t step) const { return excerpt_.steps[step].frame; }
  [[nodiscard]] bool on_tape(std::size_t step) const { return step < excerpt_.steps.size(); }
  [[nodiscard]] std::string name(std::size_t step) const { return frame_name(excerpt_, step, roles_); }
  [[nodiscard]] ByteView bytes(std::size_t which) const { return came_[which].bytes; }

  // Whether the n-th frame that came is that of the tape.
  [[nodiscard]] bool is(std::size_t which, std::size_t step) const {
    return which < came_.size() && on_tape(step) && frame(step).is(came_[which].bytes);
  }
  // The same, or what came of it is its beginning.
  [[nodiscard]] bool begins(std::size_t which, std::size_t step) const {
    if (is(which, step)) return true;
    return which < came_.size() && on_tape(step) && came_[which].open_end &&
           starts_with(frame(step).bytes, came_[which].bytes);
  }

  [[nodiscard]] Cause make(Kind kind, bool certain, std::string text, std::size_t step) const {
    return {kind, certain, std::move(text),
            on_tape(step) ? std::optional(frame(step).exchange) : std::nullopt};
  }

  [[nodiscard]] static Cause either(const Cause& one, const Cause& other) {
    static constexpr std::string_view kLooks = "looks like ";
    const auto plain = [](std::string text) {
      return text.starts_with(kLooks) ? text.substr(kLooks.size()) : text;
    };
    return {one.kind, false, std::string(kLooks) + plain(one.text) + "; or " + plain(other.text),
            one.request};
  }

  // The next request stands where the line end is due.
  [[nodiscard]] std::optional<Cause> missing_line_end() const {
    if (!on_tape(place_)) return std::nullopt;
    const ByteView whole = frame(place_).bytes;
    const ByteView body = body_of(whole);
    if (body.size() == whole.size() || body.empty() || !starts_with(bytes(0), body)) return std::nullopt;
    const ByteView rest = bytes(0).subspan(body.size());
    if (rest.empty() || is_line_end(rest.front())) return std::nullopt;
    const auto goes_on_with = [&](std::size_t step) {
      return on_tape(step) && !body_of(frame(step).bytes).empty() &&
             (starts_with(rest, body_of(frame(step).bytes)) ||
              (came_[0].open_end && starts_with(frame(step).bytes, rest)));
    };
    const bool known = goes_on_with(place_ + 1) || goes_on_with(place_);
    if (!known) return std::nullopt;
    return make(Kind::terminator, true,
                "terminator missing: " + name(place_) + " came without its " +
                    named_bytes(whole.subspan(body.size())) + ", and the next one right behind it",
                place_);
  }

  // "requests 4 to 6"
  [[nodiscard]] std::string names(std::size_t first, std::size_t last) const {
    if (first == last) return name(first);
    return name(first) + " to " + std::to_string(frame(last).exchange);
  }

  [[nodiscard]] Cause left_out(std::size_t next, bool certain) const {
    const std::string which = names(place_, next - 1);
    return make(Kind::left_out, certain,
                (certain ? "" : "looks like ") + which + " left out: " + name(next) + " came instead",
                place_);
  }

  [[nodiscard]] Cause swapped(std::size_t later, bool certain) const {
    const bool whole = frame(place_).parts == 1 && frame(later).parts == 1;
    const std::string both = whole ? "exchanges " + std::to_string(frame(place_).exchange) + " and " +
                                         std::to_string(frame(later).exchange)
                                   : name(place_) + " and " + name(later);
    const std::string text = later == place_ + 1
                                 ? both + " swapped: " + name(later) + " came first"
                                 : "wrong order: " + name(later) + " came before " + name(place_);
    return make(Kind::swapped, certain, (certain ? "" : "looks like ") + text, place_);
  }

  // A request that the tape has further on.
  [[nodiscard]] std::optional<Cause> later_request() const {
    for (std::size_t later = place_ + 1; on_tape(later); ++later) {
      if (!is(0, later)) continue;
      const bool order = begins(1, place_);
      const bool goes_on = begins(1, later + 1);
      if (order != goes_on) return order ? swapped(later, true) : left_out(later, true);
      if (came_.size() > 1 && !order) return left_out(later, false);
      if (came_.size() == 1 && answered_) return left_out(later, true);
      return make(Kind::early, false,
                  "looks like " + names(place_, later - 1) + " left out, or swapped with " + name(later) +
                      ", which came instead",
                  place_);
    }
    return std::nullopt;
  }

  // One that it had written before.
  [[nodiscard]] std::optional<Cause> earlier_request() const {
    for (std::size_t before = place_; before-- > 0;) {
      if (!is(0, before)) continue;
      const bool last = before + 1 == place_;
      const bool goes_on = begins(1, place_);
      const bool goes_back = !last && begins(1, before + 1) && !goes_on;
      const bool at_end = !on_tape(place_);
      const bool certain = goes_on || goes_back || (at_end && came_.size() == 1);
      std::string text = certain ? "" : "looks like ";
      if (goes_back) {
        text += "it began again with " + name(before) + " instead of going on";
      } else {
        text += name(before) + (at_end ? ", the last," : "");
        if (at_end && !last) text = (certain ? "" : "looks like ") + name(before);
        text += last ? " sent twice" : " sent again";
        text += at_end ? "" : " before " + name(place_);
      }
      return make(last ? Kind::twice : Kind::again, certain, std::move(text), before);
    }
    return std::nullopt;
  }

  // The beginning of a later one, of which no more came.
  [[nodiscard]] std::optional<Cause> broken_later_request() const {
    if (came_.size() > 1 || !came_[0].open_end || bytes(0).size() < 2) return std::nullopt;
    for (std::size_t later = place_ + 1; on_tape(later); ++later) {
      if (!begins(0, later) || starts_with(frame(place_).bytes, bytes(0))) continue;
      return make(Kind::early, false,
                  "looks like " + names(place_, later - 1) + " left out, or swapped with " + name(later) +
                      ", whose beginning came instead",
                  place_);
    }
    return std::nullopt;
  }

  [[nodiscard]] Cause at_end() const {
    const bool only_line_end = std::ranges::all_of(bytes(0), is_line_end);
    const std::string what = only_line_end && came_.size() == 1
                                 ? counted(bytes(0).size(), "byte") + " more at the end"
                                 : std::string("one ") + std::string(roles_.write) + " more at the end";
    return make(Kind::at_end, true, what + ": " + bytes_text(bytes(0)) + ", where the tape has nothing more",
                place_);
  }

  [[nodiscard]] Cause added() const {
    const bool few = bytes(0).size() <= 2;
    const std::string where = " before " + name(place_);
    if (few) {
      return make(Kind::byte_more, true,
                  number_word(bytes(0).size()) + (bytes(0).size() == 1 ? " byte" : " bytes") + " more" +
                      where + ": " + named_bytes(bytes(0)),
                  place_);
    }
    return make(Kind::unknown_request, true,
                "one " + std::string(roles_.request) + " more" + where + ": " + bytes_text(bytes(0)) +
                    ", which the tape does not have there",
                place_);
  }

  [[nodiscard]] Cause another() const {
    Cause cause = edit_cause(excerpt_, place_, came_[0], name(place_));
    cause.request = frame(place_).exchange;
    if (cause.kind != Kind::changed || resembles(frame(place_), came_[0])) return cause;
    cause.kind = Kind::unknown_request;
    cause.certain = begins(1, place_ + 1);
    cause.text = "another " + std::string(roles_.request) + " than " + name(place_) + ": " +
                 bytes_text(bytes(0)) + ", which the tape does not have near it";
    return cause;
  }

  const TapeExcerpt& excerpt_;
  const std::vector<CameFrame>& came_;
  bool answered_;
  const Roles& roles_;
  std::size_t place_;
};

}  // namespace

std::string frame_name(const TapeExcerpt& excerpt, std::size_t step, const Roles& roles) {
  const TapeFrame& frame = excerpt.steps[step].frame;
  const std::string request = std::string(roles.request) + ' ' + std::to_string(frame.exchange);
  if (frame.parts == 1) return request;
  return (excerpt.lines ? "line " : "part ") + std::to_string(frame.part) + " of " + request;
}

Cause request_cause(const TapeExcerpt& excerpt, const std::vector<CameFrame>& came, bool answered,
                    const Roles& roles) {
  return Requests(excerpt, came, answered, roles).cause();
}

}  // namespace porttape
