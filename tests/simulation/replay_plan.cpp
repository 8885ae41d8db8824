#include "tests/simulation/replay_plan.hpp"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

namespace porttape::simulation {

using std::chrono::milliseconds;
using Kind = TapeItem::Kind;

std::string_view name_of(Mistake::Kind kind) {
  switch (kind) {
    case Mistake::Kind::none:
      return "nothing wrong";
    case Mistake::Kind::byte:
      return "a wrong byte";
    case Mistake::Kind::missing:
      return "a write without its end";
    case Mistake::Kind::extra:
      return "a byte too many in a write";
    case Mistake::Kind::trailing:
      return "a byte behind the last write";
    case Mistake::Kind::settings:
      return "other settings";
    case Mistake::Kind::time:
      return "a write at another time";
    case Mistake::Kind::early:
      break;
  }
  return "an early end";
}

ReplayPlan::ReplayPlan(World& world, const Circumstances& circumstances) : circumstances_(circumstances) {
  TapeScript::Wanted wanted{.half_closes = circumstances.half_closes};
  if (world.chance(0.25)) strictness_ = world.chance(0.5) && hurries() && !stalls() ? 2 : 0;
  if (world.chance(0.25)) timing_ = world.chance(0.5) || is_punctual() ? "recorded" : "none";
  if (world.chance(0.3)) rate_ = static_cast<double>(world.between(1, 80)) / 8;
  // By the recorded clock a driver that has to wait for pieces writes late.
  if (!is_punctual() && world.chance(0.5))
    chunks_ = std::array{"bytes", "random:7", "recorded", "burst"}.at(
        static_cast<std::size_t>(world.between(0, 3)));
  if (world.chance(0.4)) on_mismatch_ = world.chance(0.5) ? "fail" : "resync";
  if (world.chance(0.2)) at_end_ = world.chance(0.5) ? "hangup" : "exit";
  looks_up_ = !is_punctual() && is_gated() && world.chance(0.2);
  checks_settings_ = !looks_up_ && world.chance(0.5);
  if (is_punctual() && world.chance(0.5)) jitter_ = milliseconds(world.between(10, 200));
  wanted.most_sessions = is_gated() && world.chance(0.4) ? 4 : 1;
  wanted.only_bytes = is_punctual();
  wanted.gaps = !looks_up_ && world.chance(0.3);
  if (looks_up_) wanted.half_closes = wanted.hang_ups = false;
  if (world.chance(0.1)) wanted.longest_gap = Micros(3'000'000);
  script_ = TapeScript(world, wanted);
  if (world.chance(0.15)) max_gap_ = Micros(world.between(1, 300) * 1000);
  starts_paused_ = !is_punctual() && world.chance(0.05);
  if (!is_punctual() && world.chance(0.4)) controls_ = world.between(1, 8);
  writes_ahead_ = !is_punctual() && !max_gap_ && world.chance(0.2);
  cut_gaps();
  find_answers();
  choose_mistake(world);
  choose_rules();
  find_reads();
  pauses_decide_ = looks_up_ && one_request_begins_another();
}

OptionValues ReplayPlan::options() const {
  OptionValues values{{"chunks", chunks_},
                      {"once", "1"},
                      {"strictness", std::to_string(strictness_)},
                      {"timing", timing_},
                      {"rate", fmt::format("{}", rate_)},
                      {"on-mismatch", on_mismatch_},
                      {"at-end", at_end_}};
  if (checks_settings_) values.insert({"check-settings", "1"});
  if (looks_up_) values.insert({"match", "lookup"});
  if (starts_paused_) values.insert({"start-paused", "1"});
  if (is_punctual())
    values.insert({"jitter", std::to_string(std::chrono::duration_cast<milliseconds>(jitter_).count())});
  if (max_gap_) values.insert({"max-gap", fmt::format("{}", static_cast<double>(max_gap_->count()) / 1e6)});
  if (mistake_.offset % 5 == 1) values.insert({"faults", "drop:p=0;delay:p=0;hangup:p=0"});
  return values;
}

std::string ReplayPlan::to_text() const {
  return fmt::format(
      "strictness {}, timing {}, rate {}, chunks {}, on-mismatch {}, at-end {}, max-gap {} us{}{}{}{}",
      strictness_, timing_, rate_, chunks_, on_mismatch_, at_end_, max_gap_.value_or(Micros(0)).count(),
      looks_up_ ? ", by lookup" : "",
      echoes_  ? ", with rules and replies"
      : ruled_ ? ", with rules"
               : "",
      hurries() ? ", a driver that hurries" : "", writes_ahead_ ? ", and writes ahead" : "");
}

// Idle gaps that are longer than max-gap count as that.
void ReplayPlan::cut_gaps() {
  Micros last{};
  Micros cut{};
  for (const TapeItem& item : script_.items()) {
    const bool counts = !item.is_note() && item.kind != Kind::flush && item.kind != Kind::settings;
    if (counts) {
      if (max_gap_ && item.at - last > *max_gap_) cut += item.at - last - *max_gap_;
      last = item.at;
    }
    times_.push_back(item.at - cut);
  }
}

// Each read with what it is timed from: the driver's write before it, its open or its end of writing.
void ReplayPlan::find_answers() {
  constexpr Micros kBurstGap{500};
  constexpr Micros kLongestBurst{100'000};
  std::size_t begin = 0;
  std::size_t gate = 0;
  std::size_t exchange = 0;
  Micros burst_began{};
  Micros last_read = -kBurstGap;
  for (std::size_t n = 0; n < script_.items().size(); ++n) {
    const TapeItem& item = script_.items()[n];
    const bool by_driver = item.kind == Kind::open || item.writes() || item.kind == Kind::driver_ends;
    if (by_driver) gate = n;
    if (by_driver || item.kind == Kind::close) last_read = -kBurstGap;
    // "What the device says up to the driver's next write": its end of writing is none.
    if (item.kind == Kind::open || item.writes() || item.kind == Kind::close) ++exchange;
    if (!item.reads()) continue;
    const bool joins =
        chunks_ == "burst" && item.at - last_read < kBurstGap && item.at - burst_began <= kLongestBurst;
    if (!joins) burst_began = item.at;
    last_read = item.at;
    const Micros cut = item.at - times_[n];
    answers_.push_back({.item = n,
                        .begin = begin,
                        .end = begin + item.data.size(),
                        .at = burst_began - cut,
                        .gate = gate,
                        .exchange = exchange});
    begin += item.data.size();
  }
}

// A request is the run of writes between two answers. An open or a close ends it, too. `wrong`: with the
// driver's mistake; only the one that has it.
std::vector<Bytes> ReplayPlan::requests(bool wrong) const {
  std::vector<Bytes> all(1);
  bool here = false;
  for (std::size_t n = 0; n < script_.items().size(); ++n) {
    const TapeItem& item = script_.items()[n];
    if (item.writes()) {
      const Bytes data = wrong && n == mistake_.item ? mistaken(item.data) : item.data;
      here = here || n == mistake_.item;
      all.back().insert(all.back().end(), data.begin(), data.end());
    } else if (item.reads() || item.kind == Kind::close) {
      if (wrong && here) return {all.back()};
      all.emplace_back();
    }
  }
  std::erase_if(all, [](const Bytes& request) { return request.empty(); });
  return all;
}

bool ReplayPlan::one_request_begins_another() const {
  const std::vector<Bytes> all = requests(false);
  return std::ranges::any_of(all, [&all](const Bytes& one) {
    return std::ranges::any_of(all, [&one](const Bytes& other) {
      return one.size() < other.size() && std::equal(one.begin(), one.end(), other.begin());
    });
  });
}

Bytes ReplayPlan::mistaken(Bytes data) const {
  const auto place = data.begin() + static_cast<std::ptrdiff_t>(mistake_.byte);
  switch (mistake_.kind) {
    case Mistake::Kind::byte:
      *place ^= Byte{1};
      break;
    case Mistake::Kind::missing:
      data.erase(place, data.end());
      break;
    case Mistake::Kind::extra:
      data.insert(place, kExtraByte);
      break;
    case Mistake::Kind::trailing:
      data.push_back(kExtraByte);
      break;
    default:
      break;
  }
  return data;
}

bool ReplayPlan::mistake_is_asked() const {
  const std::vector<Bytes> all = requests(false);
  const std::vector<Bytes> wrong = requests(true);
  if (wrong.empty()) return false;
  const Bytes& asked = wrong.front();
  std::vector<bool> ends(asked.size() + 1);  // where a request may end
  ends[0] = true;
  for (std::size_t at = 0; at < asked.size(); ++at) {
    if (!ends[at]) continue;
    const ByteView rest = ByteView(asked).subspan(at);
    for (const Bytes& each : all) {
      if (each.size() <= rest.size() && std::ranges::equal(each, rest.first(each.size())))
        ends[at + each.size()] = true;
    }
  }
  return ends.back();
}

bool ReplayPlan::is_behind_gap(const Answer& answer) const {
  const auto begin = script_.items().begin();
  return std::any_of(begin, begin + static_cast<std::ptrdiff_t>(answer.item),
                     [](const TapeItem& item) { return item.bytes > 0; });
}

void ReplayPlan::choose_mistake(World& world) {
  const auto chosen = static_cast<Mistake::Kind>(std::max<std::int64_t>(0, world.between(-9, 7)));
  std::vector<std::size_t> places;
  const auto& items = script_.items();
  for (std::size_t n = 0; n < items.size(); ++n) {
    const bool settings = chosen == Mistake::Kind::settings;
    if (settings ? items[n].kind == Kind::settings : items[n].writes()) places.push_back(n);
  }
  // What a hang-up has made void is not compared, and a gap of the tape swallows bytes.
  const bool swallowed = std::ranges::any_of(items, [](const TapeItem& item) { return item.bytes > 0; });
  if (places.empty() || swallowed || script_.has(Kind::hang_up)) return;
  if (chosen == Mistake::Kind::time && !is_punctual()) return;
  // What comes behind the end of a run is of no run.
  const bool trails = chosen == Mistake::Kind::trailing;
  if (trails && (script_.has(Kind::driver_ends) || !goes_on_at_end())) return;
  mistake_.kind = chosen;
  mistake_.item =
      trails
          ? places.back()
          : places[static_cast<std::size_t>(world.between(0, static_cast<std::int64_t>(places.size()) - 1))];
  const TapeItem& item = items[mistake_.item];
  if (item.writes()) {
    mistake_.byte =
        static_cast<std::size_t>(world.between(0, static_cast<std::int64_t>(item.data.size()) - 1));
    for (std::size_t n = 0; n < mistake_.item; ++n)
      mistake_.offset += items[n].writes() ? items[n].data.size() : 0;
    mistake_.offset += mistake_.byte;
  }
  if (chosen != Mistake::Kind::time) return;
  mistake_.time = jitter_ + milliseconds(world.between(20, 200));
  std::size_t before = mistake_.item;
  while (before > 0 && (before == mistake_.item || items[before].kind == Kind::close)) --before;
  const double gap = nanos(times_[mistake_.item] - times_[before]) / rate_;
  if (is_gated() && gap > static_cast<double>(mistake_.time.count()) && world.chance(0.7))
    mistake_.time = -mistake_.time;
}

// By what the tape has, so that what is drawn for other seeds stays.
void ReplayPlan::choose_rules() {
  // Behind a gap the place is found by equal bytes alone, whatever may vary.
  const bool has_gap =
      std::ranges::any_of(script_.items(), [](const TapeItem& item) { return item.bytes > 0; });
  ruled_ = script_.writes().size() % 4 == 1 && strictness_ > 0 && !looks_up_ && !has_gap &&
           mistake_spares_frames();
  if (!ruled_) return;
  script_.number();
  const bool knows_requests = !script_.has(Kind::driver_ends) && !script_.has(Kind::hang_up);
  echoes_ = as_recorded() && is_gated() && knows_requests;
}

// Where a byte of a frame is wrong, the frame is none, or is right.
bool ReplayPlan::mistake_spares_frames() const {
  using Wrong = Mistake::Kind;
  const bool within =
      mistake_.kind == Wrong::byte || mistake_.kind == Wrong::missing || mistake_.kind == Wrong::extra;
  return !within || mistake_.byte >= NumberedFrame::kSize;
}

std::string ReplayPlan::rules() const {
  const std::string place = fmt::format("at = {}, size = 2", NumberedFrame::kNumber);
  std::string text = fmt::format(
      "format = 'porttape-rules'\nversion = 1\n"
      "[[frame]]\nname = 'numbered'\nkind = 'fixed'\nstart_hex = 'C3 D4 E5'\nsize = {}\n"
      "[[rule]]\nname = 'number'\nframe = 'numbered'\nat = {}\nsize = 2\nignore = true\n",
      NumberedFrame::kSize, NumberedFrame::kNumber);
  if (echoes_)
    text += fmt::format(
        "[[reply]]\nname = 'number'\nframe = 'numbered'\nfrom = {{ {0} }}\n"
        "answer_frame = 'numbered'\nto = {{ {0} }}\n",
        place);
  return text;
}

Bytes ReplayPlan::written(std::size_t item) const {
  Bytes data = script_.items()[item].data;
  if (!ruled_ || !NumberedFrame::begins(data)) return data;
  // Not the first byte of a frame.
  data[NumberedFrame::kNumber] = static_cast<Byte>(item % 64);
  data[NumberedFrame::kNumber + 1] ^= Byte{0x20};
  return data;
}

// A request is all that is written between two answers; the last frame of it counts.
void ReplayPlan::find_reads() {
  Bytes request;
  bool answered = false;
  const auto& items = script_.items();
  for (std::size_t n = 0; n < items.size(); ++n) {
    Bytes data = items[n].data;
    const bool numbered = NumberedFrame::begins(data);
    if (items[n].writes()) {
      if (std::exchange(answered, false)) request.clear();
      if (numbered) request = written(n);
    }
    if (!items[n].reads()) continue;
    answered = true;
    if (echoes_ && numbered && !request.empty()) {
      std::copy_n(request.begin() + NumberedFrame::kNumber, 2, data.begin() + NumberedFrame::kNumber);
    }
    reads_.insert(reads_.end(), data.begin(), data.end());
  }
}

}  // namespace porttape::simulation
