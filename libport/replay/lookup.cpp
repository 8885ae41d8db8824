#include "libport/replay/lookup.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

Bytes first_of(ByteView bytes) {
  const ByteView shown = bytes.first(std::min(bytes.size(), Mismatch::kMostShown));
  return {shown.begin(), shown.end()};
}
Bytes last_of(ByteView bytes) {
  const ByteView shown = bytes.last(std::min(bytes.size(), Mismatch::kMostShown));
  return {shown.begin(), shown.end()};
}

// Where the tape goes on, when `next` was expected.
std::string went_on_to(const RequestIndex& index, std::uint32_t next, std::uint32_t exchange) {
  const std::string where = " at " + seconds_text(to_us(index.exchange(exchange).began));
  const auto requests = [](std::uint32_t count) {
    return std::to_string(count) + (count == 1 ? " request" : " requests");
  };
  if (exchange == next) return "the tape goes on" + where + ", with the request that was next";
  if (exchange > next) return "the tape goes on" + where + ": " + requests(exchange - next) + " skipped";
  return "the tape goes back " + requests(next - exchange) + " and on" + where;
}

}  // namespace

Lookup::Lookup(const ReplayConfig& config, const Engine::TapeFacts& facts, const Engine::Parts& parts,
               Budget& budget, Pieces& pieces, const ReplayClock& clock, Replies* replies)
    : index_(*parts.index, budget, parts.expectation),
      matcher_(index_, parts.expectation, clock, config.burst_gap, config.on_mismatch == OnMismatch::resync),
      player_(config, joins_bursts(config.chunks, facts.stamped_at_arrival), parts.half_closes, index_,
              *parts.answers, budget, pieces, clock, parts.expectation, replies),
      keeps_requests_(replies != nullptr) {}

void Lookup::begin_run() {
  begin_books();
  from_.reset();
  kinds_.clear();
  played_ = 0;
}

void Lookup::begin_behind_end() {
  begin_books();
  for (OfKind& kind : kinds_) kind.asked = 0;
}

void Lookup::begin_books() {
  begin_session();
  player_.begin_run();
  went_on_.clear();
  matcher_.begin();
  answered_ = unknown_ = matched_ = 0;
  cut_off_.reset();
}

void Lookup::begin_session() {
  note_cut_off();
  matcher_.drop(matcher_.text().size());
  known_ = 0;
  player_.begin_session();
}

void Lookup::go_on_from(std::uint64_t position, std::uint64_t offset, std::size_t known) {
  player_.drop();
  from_ = position;
  known_ = known;
  told_ = true;
  kinds_.clear();
  matcher_.begin(offset - known, true);
}

void Lookup::write(Instant now, ByteView data) { matcher_.add(now, data); }

void Lookup::begin_on_index() {
  for (std::uint32_t kind = 0; kind < index_.kinds(); ++kind) kinds_.push_back({index_.kind(kind).first, 0});
  matcher_.restart();
  if (!from_) return;
  next_ = index_.exchange_at(*from_);
  const std::uint64_t inside =
      next_ < index_.exchanges() ? *from_ - std::min(*from_, index_.exchange(next_).writes) : 0;
  matcher_.drop(known_ - std::min<std::uint64_t>(known_, inside));
  known_ = 0;
}

void Lookup::play(Instant now, std::size_t max_bytes, bool blocked, ReplayActions& out) {
  const bool whole = index_.read_on();
  player_.play(now, max_bytes, blocked, out);
  if (!whole && !index_.error()) player_.wake_at(now);
}

std::optional<Mismatch> Lookup::find() {
  if (!index_.whole()) return std::nullopt;
  if (kinds_.empty()) begin_on_index();
  while (true) {
    const RequestMatcher::Step step = matcher_.next();
    switch (step.outcome) {
      case RequestMatcher::Outcome::taken:
        return std::nullopt;
      case RequestMatcher::Outcome::unknown:
        ++unknown_;
        told_ = true;
        return unknown();
      case RequestMatcher::Outcome::request:
        if (auto mismatch = answer(step)) return mismatch;
    }
  }
}

// Of several kinds that it may be of, the one that comes first on the tape and was not played yet.
std::optional<Mismatch> Lookup::answer(const RequestMatcher::Step& step) {
  if (from_) return answer_nearest(step);
  const auto rank = [this](std::uint32_t kind) {
    const OfKind& of = kinds_[kind];
    return std::pair(of.next == RequestIndex::kNone, of.next);
  };
  const std::uint32_t kind = *std::ranges::min_element(step.kinds, {}, rank);
  OfKind& of = kinds_[kind];
  const bool again = of.next == RequestIndex::kNone;
  const std::uint32_t exchange = again ? index_.kind(kind).last : of.next;
  if (!again) {
    ++played_;
    of.next = index_.exchange(exchange).next;
  }
  ask_for(exchange, of.asked++, step);
  return std::nullopt;
}

void Lookup::ask_for(std::uint32_t exchange, std::uint64_t again, const RequestMatcher::Step& step) {
  AnswerPlayer::Asked asked{.exchange = exchange, .at = step.completed, .again = again};
  if (keeps_requests_) {
    const ByteView came = matcher_.text().first(step.size);
    asked.request.assign(came.begin(), came.end());
  }
  ++answered_;
  matched_ += step.size;
  player_.add(std::move(asked));
  matcher_.drop(step.size);
}

// The tape goes on there; where that is not the next request, and no mismatch was told that led there, it is
// one.
std::optional<Mismatch> Lookup::answer_nearest(const RequestMatcher::Step& step) {
  const std::uint32_t exchange = nearest(step);
  const std::string where = went_on_to(index_, next_, exchange);
  std::optional<Mismatch> mismatch;
  if (!std::exchange(told_, false) && exchange != next_) {
    mismatch = expected(next_, 0, 0);
    mismatch->offset = matcher_.text_offset();
    mismatch->got = first_of(matcher_.text().first(step.size));
    mismatch->went_on = where;
  } else if (went_on_.empty()) {
    went_on_ = where;
  }
  next_ = exchange + 1;
  ask_for(exchange, 0, step);
  return mismatch;
}

std::uint32_t Lookup::nearest(const RequestMatcher::Step& step) const {
  std::uint32_t behind = RequestIndex::kNone;  // on the tape, the first
  std::uint32_t before = 0;                    // the last
  for (const std::uint32_t kind : step.kinds) {
    for (std::uint32_t at = index_.kind(kind).first; at != RequestIndex::kNone;
         at = index_.exchange(at).next) {
      if (at >= next_) {
        behind = std::min(behind, at);
        break;
      }
      before = std::max(before, at);
    }
  }
  return behind != RequestIndex::kNone ? behind : before;
}

Mismatch Lookup::unknown() const {
  const RequestMatcher::Nearest& nearest = matcher_.nearest();
  const bool knows_next = from_ && next_ < index_.exchanges() && nearest.came == 0;
  const ByteView text = matcher_.text();
  Mismatch mismatch = expected(knows_next ? next_ : nearest.exchange, nearest.recorded, nearest.came);
  mismatch.offset = matcher_.text_offset() + nearest.came;
  const ByteView got = text.subspan(nearest.came);
  mismatch.got = first_of(got);
  mismatch.came.assign(got.begin(),
                       got.begin() + static_cast<std::ptrdiff_t>(std::min(got.size(), Mismatch::kMostCame)));
  mismatch.before = last_of(text.first(nearest.came));
  return mismatch;
}

// What of a request is behind so many recorded bytes, which go with so many that came. Behind the tape's last
// one nothing is.
Mismatch Lookup::expected(std::uint32_t exchange, std::size_t recorded, std::size_t came) const {
  Mismatch mismatch;
  if (exchange >= index_.exchanges()) {
    mismatch.kind = MismatchKind::extra;
    return mismatch;
  }
  const ByteView rest = index_.request(exchange).subspan(recorded);
  mismatch.expected = first_of(rest);
  mismatch.block_before = came;
  mismatch.block_after = rest.size();
  mismatch.tape = index_.exchange(exchange).asked;
  mismatch.tape_offset = index_.exchange(exchange).writes + recorded;
  mismatch.exchange = exchange + 1;
  return mismatch;
}

void Lookup::note_cut_off() {
  const RequestMatcher::Nearest& nearest = matcher_.nearest();
  if (cut_off_ || matcher_.text().empty() || matcher_.between()) return;
  if (nearest.exchange == RequestIndex::kNone) return;
  cut_off_ = {last_of(matcher_.text()), first_of(index_.request(nearest.exchange).subspan(nearest.recorded)),
              nearest};
}

bool Lookup::cut_off() {
  note_cut_off();
  return cut_off_.has_value();
}

void Lookup::report(RunReport& report) const {
  LookupReport& told = report.lookup.emplace();
  told.requests = index_.kinds();
  told.answered = answered_;
  told.unknown = unknown_;
  told.undelivered = player_.undelivered();
  for (std::uint32_t kind = 0; kind < index_.kinds(); ++kind) {
    if (!kinds_.empty() && kinds_[kind].asked > 0) {
      ++told.asked;
    } else if (told.never_asked.size() < LookupReport::kMostListed) {
      const std::uint32_t first = index_.kind(kind).first;
      const ByteView request = index_.request(first);
      told.never_asked.push_back(
          {index_.exchange(first).began, index_.exchange(first).writes, request.size(), first_of(request)});
    }
  }
  report.from_driver_matched = matched_;
  if (!cut_off_) return;
  const RequestIndex::Exchange& exchange = index_.exchange(cut_off_->place.exchange);
  report.next_expected = cut_off_->rest;
  report.next_expected_block = cut_off_->rest.size();
  report.next_expected_before = cut_off_->came;
  report.next_expected_offset = exchange.writes + cut_off_->place.recorded;
  report.next_expected_tape = exchange.asked;
}

}  // namespace porttape
