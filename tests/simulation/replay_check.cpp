#include "tests/simulation/replay_check.hpp"

#include <algorithm>
#include <utility>

namespace porttape::simulation {
namespace {

// What the documents allow beyond the moment at which an answer is due, and what the simulated machine adds.
constexpr double kLatest = 5e6;           // ns
constexpr double kLatestPiece = 110e6;    // "none comes more than 100 ms after it was due"
constexpr double kEarliest = 2e3;         // stamps are whole microseconds
constexpr double kPausedEarliest = 50e3;  // a pause counts from the turn of the loop in which it is asked for
constexpr Nanos kGatePatience = std::chrono::seconds(1);

}  // namespace

ReplayCheck::ReplayCheck(World& world, std::string name, const ReplayPlan& plan)
    : world_(&world),
      name_(std::move(name)),
      plan_(&plan),
      clock_(plan.rate(), plan.starts_paused()),
      done_(plan.script().items().size()),
      due_(plan.answers().size()) {}

void ReplayCheck::opened(std::size_t item) {
  for (const Answer& answer : plan_->answers()) places_.insert(answer.begin);
  if (item == 0) first_opened_ = last_event_ = world_->loop().now();
  notice_event();
  reopened_ = reopened_ || item > 0;
  did(item);
}

void ReplayCheck::did(std::size_t item) { done_[item] = clock_.at(world_->loop().now()); }

void ReplayCheck::wrote(std::size_t bytes) {
  written_ += bytes;
  if (bytes > 0) notice_event();
}

void ReplayCheck::hung_up() { hung_up_by_hand_ = hung_up_by_hand_ || clock_.paused(); }

void ReplayCheck::gave_up() {
  gave_up_ = true;
  places_.insert(delivered_);
}

// The driver wrote, or something came to it.
void ReplayCheck::notice_event() {
  const Instant now = world_->loop().now();
  longest_quiet_ = std::max(longest_quiet_, now - last_event_);
  last_event_ = now;
}

bool ReplayCheck::gates_are_lenient() const {
  const bool patience_may_end = world_->loop().now() - first_opened_ >= kGatePatience;
  return plan_->strictness() == 0 && plan_->is_gated() &&
         (longest_quiet_ >= std::chrono::milliseconds(50) || patience_may_end);
}

bool ReplayCheck::half_close_may_be_missed() const { return longest_quiet_ >= kGatePatience; }

bool ReplayCheck::has_come(std::size_t item) const {
  const auto& answers = plan_->answers();
  const auto answer =
      std::find_if(answers.rbegin(), answers.rend(), [item](const Answer& each) { return each.item < item; });
  return answer == answers.rend() || delivered_ >= answer->end;
}

// How much of the device's bytes may have come by now: none that follows a byte which is not written.
std::size_t ReplayCheck::released() const {
  std::uint64_t writes = 0;
  std::size_t reads = 0;
  for (const TapeItem& item : plan_->script().items()) {
    if (item.reads()) {
      reads += item.data.size();
    } else if (item.writes() && (writes += item.data.size()) > written_) {
      break;
    }
  }
  return reads;
}

void ReplayCheck::came(ByteView data) {
  if (clock_.paused() && steps_left_ == 0 && !by_hand_)
    world_->wrong("{}: {} bytes came while it is paused", name_, data.size());
  check_order(data);
  const std::size_t begin = delivered_;
  delivered_ += data.size();
  notice_event();
  if (!plan_->as_recorded() || gates_are_lenient() || plan_->pauses_decide()) return;
  check_time(begin, delivered_);
  const auto last =
      std::ranges::find_if(plan_->answers(), [this](const Answer& each) { return each.end >= delivered_; });
  if (plan_->is_gated() && delivered_ > released() && !plan_->is_behind_gap(*last))
    world_->wrong("{}: byte {} came before what it answers was written", name_, delivered_);
}

void ReplayCheck::check_order(ByteView data) {
  // A wrong byte may make a request of the tape out of what was none, so short as these are: its answer comes
  // then, where the tape is searched for requests. So does that of a request which begins another one, when
  // the driver pauses behind it. What a driver leaves unread when it closes is lost.
  const Bytes& expected = plan_->reads();
  // Where patience may end, the device may say to nobody, between two sessions, what belongs to the next one.
  const bool talks_to_nobody = gates_are_lenient() && reopened_;
  if (talks_to_nobody) places_.insert(delivered_);
  const bool any_order = plan_->pauses_decide() || talks_to_nobody ||
                         (!plan_->as_recorded() && (plan_->resyncs() || plan_->looks_up() || gave_up_));
  const bool in_order =
      delivered_ + data.size() <= expected.size() &&
      std::equal(data.begin(), data.end(), expected.begin() + static_cast<std::ptrdiff_t>(delivered_));
  if (!(any_order ? is_of_whole_answers(data) : in_order))
    world_->wrong("{}: the driver got what is not on the tape, behind byte {}", name_, delivered_);
}

// The tape's answers, each whole, in whatever order and however often.
bool ReplayCheck::is_of_whole_answers(ByteView data) {
  const Bytes& reads = plan_->reads();
  const auto& answers = plan_->answers();
  const auto begins = [&](std::size_t place) {
    return place == reads.size() || std::ranges::find(answers, place, &Answer::begin) != answers.end();
  };
  for (const Byte byte : data) {
    if (std::ranges::any_of(places_, begins)) {
      for (const Answer& answer : answers) places_.insert(answer.begin);
    }
    std::set<std::size_t> next;
    for (const std::size_t place : places_) {
      if (place < reads.size() && reads[place] == byte) next.insert(place + 1);
    }
    places_ = std::move(next);
  }
  return !places_.empty();
}

// By what the driver did. Nullopt if that is not known.
std::optional<double> ReplayCheck::due_of(const Answer& answer) const {
  if (!plan_->is_gated()) return *done_[0] + nanos(answer.at);
  const std::optional<double> done = done_[answer.gate];
  // The end of the driver's writing may have come too late to be waited for.
  const bool ends = plan_->script().items()[answer.gate].kind == TapeItem::Kind::driver_ends;
  if (ends && half_close_may_be_missed()) return std::nullopt;
  if (!done || plan_->timing() == "none") return done;
  return *done + nanos(answer.at - plan_->time_of(answer.gate));
}

void ReplayCheck::check_time(std::size_t begin, std::size_t end) {
  const double now = clock_.at(world_->loop().now());
  double latest = 0;
  const auto& answers = plan_->answers();
  for (std::size_t n = 0; n < answers.size() && answers[n].begin < end; ++n) {
    const Answer& answer = answers[n];
    if (!due_[n]) due_[n] = due_of(answer);
    // Without a due time the driver is behind what it gets, which is found elsewhere. "A read behind a gap
    // […] comes when the driver has written something and been quiet, or by patience."
    if (!due_[n] || plan_->is_behind_gap(answer)) continue;
    const double due = *due_[n];
    latest = std::max(latest, due);
    if (answer.end <= begin) continue;
    if (clock_.paused()) {
      check_by_hand(answer, due);
    } else if (answer.exchange < hand_until_) {
      clock_.move_to(due);
    }
    // By the recorded clock a step may stand behind what the driver did next.
    const bool step_may_differ = stepped_ && !plan_->is_gated();
    const double early = (pause_ > 0 ? kPausedEarliest : kEarliest) * clock_.highest_rate();
    if (!clock_.paused() && answer.exchange >= hand_until_ && !step_may_differ && now + early < due)
      world_->wrong("{}: byte {} came {} ms before it was due", name_, std::max(begin, answer.begin),
                    (due - now) / 1e6);
    const bool prompt = plan_->hurries() && !plan_->stalls() && !stepped_ && !clock_.paused();
    const double most = (plan_->has_pieces() ? kLatestPiece : kLatest) * clock_.highest_rate();
    if (prompt && now > latest + most)
      world_->wrong("{}: byte {} came {} ms after it was due", name_, std::max(begin, answer.begin),
                    (now - latest) / 1e6);
    next_answer_ = n + (answer.end <= end ? 1 : 0);
  }
}

// A step lets come what the device says up to the driver's next write, or a second of the tape.
bool ReplayCheck::is_of_same_step(const Answer& answer) const {
  const auto at = [this](const Answer& each) { return plan_->script().items()[each.item].at; };
  return by_hand_ && by_hand_->exchange == answer.exchange &&
         at(answer) - at(*by_hand_) < std::chrono::seconds(1);
}

// While the clock stands.
void ReplayCheck::check_by_hand(const Answer& answer, double due) {
  if (!is_of_same_step(answer)) {
    if (steps_left_ == 0)
      world_->wrong("{}: byte {} came while it is paused, and no step let it come", name_, answer.begin);
    by_hand_ = answer;
    steps_left_ -= steps_left_ > 0 ? 1 : 0;
  }
  clock_.move_to(due);
}

// What comes by a request comes from within it.
void ReplayCheck::going_on() {
  // Of what was to come by hand some may be held back in pieces.
  if (plan_->has_pieces() && next_answer_ < plan_->answers().size())
    hand_until_ =
        std::max(hand_until_, plan_->answers()[next_answer_].exchange + steps_left_ + (by_hand_ ? 1 : 0));
  clock_.pause(world_->loop().now(), false);
}

void ReplayCheck::paused(bool on) {
  if (on) clock_.pause(world_->loop().now(), true);
  steps_left_ = 0;
  hung_up_by_hand_ = false;
  by_hand_.reset();
  ++pause_;
}

void ReplayCheck::has_rate(double rate) { clock_.set_rate(world_->loop().now(), rate); }

void ReplayCheck::steps(std::uint64_t count) {
  steps_left_ += count;
  steps_asked_ += count;
  stepped_ = true;
}

void ReplayCheck::refused_steps(std::uint64_t count) {
  steps_left_ -= count;
  steps_asked_ -= count;
}

void ReplayCheck::check_steps(std::size_t item) {
  if (!plan_->as_recorded() || gates_are_lenient() || plan_->pauses_decide() || !plan_->hurries() ||
      plan_->stalls() || plan_->has_pieces() || hung_up_by_hand_)
    return;
  const auto next =
      std::ranges::find_if(plan_->answers(), [this](const Answer& each) { return each.end > delivered_; });
  if (next == plan_->answers().end() || (steps_left_ == 0 && !is_of_same_step(*next))) return;
  if (plan_->is_behind_gap(*next) || next->gate >= item) return;  // the driver has not asked yet
  world_->wrong("{}: byte {} did not come by hand", name_, next->begin);
}

}  // namespace porttape::simulation
