// Any tape, any driver, any pace: the input makes a tape and a script for the driver; what must always hold
// is checked.

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "libport/replay/engine.hpp"
#include "libport/replay/tape_part.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/support/memory_tape.hpp"
#include "tests/support/random_tape.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

ReplayConfig make_config(Choices& input) {
  ReplayConfig config;
  config.strictness = static_cast<int>(input(3));
  config.timing = static_cast<Timing>(input(3));
  config.on_mismatch = static_cast<OnMismatch>(input(3));
  config.at_end = static_cast<AtEnd>(input(3));
  config.on_reopen = static_cast<OnReopen>(input(3));
  config.chunks = static_cast<Chunks>(input(5));
  config.chunk_seed = input(100);
  constexpr double kRates[] = {1, 0.5, 3, 1000};
  config.rate = kRates[input(4)];
  config.check_settings = input(2) == 1;
  if (input(3) == 0) {
    config.match = Match::lookup;
    config.strictness = std::min(config.strictness, 1);
    if (config.timing == Timing::recorded) config.timing = Timing::reactive;
    config.check_settings = false;
  }
  if (config.match == Match::lookup || config.on_mismatch == OnMismatch::resync) return config;
  constexpr std::uint64_t kLoops[] = {1, 1, 1, 2, 0};
  config.loops = kLoops[input(5)];
  if (input(4) == 0) config.start = tape_time_us(input(200'000));
  if (input(4) == 0) config.end = config.start + Micros{1 + input(300'000)};
  if (input(4) == 0) config.max_gap = Micros{input(9'000)};
  config.preroll = input(4) == 0;
  return config;
}

class Play {
 public:
  Play(const MemoryTape& tape, const ReplayConfig& config, bool sessions, bool signals, std::size_t piece)
      : tape_(tape),
        config_(config),
        part_{.until = config.end.value_or(TapeTime::max())},
        steered_(config.loops != 1 || config.start > TapeTime{} || config.end || config.preroll),
        sessions_(sessions),
        shows_signals_(signals),
        reads_(tape.all(RecordKind::read)),
        writes_(tape.all(RecordKind::write)),
        merged_(tape, MemorySource::Select::merged, piece),
        writes_alone_(tape, MemorySource::Select::writes_only, piece),
        schedule_(merged_, part_),
        write_source_(writes_alone_, part_),
        index_(tape, MemorySource::Select::merged, piece),
        answers_(tape, piece),
        engine_(config,
                {.stamped_at_arrival = sessions,
                 .opens = tape.opens(),
                 .hang_ups = tape.hang_ups(),
                 .gaps = tape.gaps(),
                 .preroll_from = config.preroll ? tape.open_before(to_us(config.start)) : std::nullopt,
                 .totals = TapeTotals{reads_.size(), writes_.size()}},
                schedule_, write_source_, {.index = &index_, .answers = &answers_, .half_closes = sessions}) {
    engine_.show_signals(shows_signals_);
  }

  void run(Choices& input) {
    while (!input.done()) {
      act(input);
      if (input(4) != 0) settle();
    }
    settle();
    engine_.finish(now_);
    for (int i = 0; !engine_.finished(); ++i) {
      require(i < 100'000, "an end comes to its end");
      take(engine_.advance(now_));
    }
    if (auto report = engine_.advance(now_).run_ended) check(*report);
    require(!engine_.advance(now_).run_ended, "a run is reported once");
  }

 private:
  void act(Choices& input) {
    switch (input(8)) {
      case 0: {
        settle();
        if (!open_) session_.clear();
        open_ = true;
        running_ = true;
        engine_.on_open(now_);
        settle();
        break;
      }
      case 1:
        settle();
        if (!open_) break;
        open_ = false;
        engine_.on_close(now_);
        settle();
        break;
      case 2: {
        const std::size_t size = 1 + input(6);  // each in its turn, whatever order a compiler likes
        write(std::string(size, static_cast<char>('a' + input(3))));
        break;
      }
      case 3:
      case 4:
        write(writes_.substr(std::min(written_.size(), writes_.size()), 1 + input(9)));
        break;
      case 5:
        if (input(3) == 0) {
          steer(input);
        } else if (engine_.holds_piece() && input(2) == 0) {
          engine_.on_taken(now_);
        } else if (input(3) == 0) {
          engine_.on_event(now_, line::Settings{{.baud = 300 * (1 + input(3))}});
        } else if (shows_signals_ && input(2) == 0) {
          engine_.on_event(now_, LineSignal{static_cast<LineSignal::Name>(input(2)), input(2) == 1});
        } else {
          engine_.set_blocked(blocked_ = !blocked_);
        }
        break;
      case 6:
        now_ += Micros{input(65536)};
        break;
      default:
        until(now_ + Micros{input(65536) * 30});
        break;
    }
  }

  void steer(Choices& input) {
    constexpr double kRates[] = {0.25, 1, 7};
    switch (input(4)) {
      case 0:
        engine_.stand(now_, stands_ = !stands_);
        break;
      case 1:
        engine_.step(now_, input(3));
        break;
      case 2:
        steered_ = true;
        engine_.seek(now_, tape_time_us(input(400'000)));
        break;
      default:
        engine_.set_rate(now_, kRates[input(3)]);
    }
    (void)engine_.playing(now_);
  }

  void write(const std::string& text) {
    if (!open_) return;
    if (running_) written_ += text;
    engine_.on_write(now_, as_bytes(text));
  }

  // Serves every deadline at its moment.
  void until(Instant end) {
    for (int i = 0;; ++i) {
      require(i < 100'000, "time goes on");
      const auto deadline = engine_.next_deadline();
      if (!deadline || *deadline > end) break;
      now_ = std::max(now_, *deadline);
      take(engine_.advance(now_, 7));
    }
    now_ = end;
  }

  void settle() {
    for (int i = 0; engine_.next_deadline().value_or(Instant::max()) <= now_; ++i) {
      require(i < 100'000, "what is due gets done");
      take(engine_.advance(now_, 7));
    }
    require(engine_.advance(now_).empty(), "nothing is due before the deadline");
  }

  void take(const ReplayActions& actions) {
    require(actions.deliver.size() <= 7, "no more than asked for");
    require(actions.deliver.empty() == actions.block_ends.empty(), "block ends go with bytes");
    require(std::is_sorted(actions.block_ends.begin(), actions.block_ends.end(), std::less_equal<>()),
            "block ends rise");
    check_signals(actions);
    if (!actions.deliver.empty()) {
      require(actions.block_ends.back() == actions.deliver.size(), "the last block end is the size");
      require(open_ && !blocked_, "bytes go to an open, unblocked line");
      session_ += as_text(actions.deliver);
      delivered_ += actions.deliver.size();
      if (!ordered()) check_parts(actions);
      require(!ordered() || steered_ || reads_.find(session_) != std::string::npos,
              "a session gets a stretch of the tape");
      if (ordered() && !steered_ && !sessions_ && config_.on_reopen != OnReopen::continue_ &&
          tape_.gaps().empty())
        check_gates();
    }
    for (const Mismatch& mismatch : actions.mismatches) {
      require(config_.strictness > 0, "strictness 0 has no mismatches");
      require(!to_text(mismatch).empty(), "a mismatch has a text");
    }
    if (actions.run_ended) check(*actions.run_ended);
  }

  void check_signals(const ReplayActions& actions) {
    require(actions.events.empty() || (open_ && shows_signals_), "signals go to a line that shows them");
    std::size_t behind = 0;
    for (const ReplayActions::Told& each : actions.events) {
      require(each.behind >= behind && each.behind <= actions.deliver.size(), "signals have their place");
      require(!is_output(std::get<LineSignal>(each.event).name), "they are the device's");
      behind = each.behind;
    }
  }

  // A tape of one session: what was delivered is the beginning of the tape; nothing comes before its
  // question.
  void check_gates() {
    require(reads_.starts_with(session_), "a session starts at the tape's start");
    if (config_.timing == Timing::recorded || config_.strictness == 0 ||
        config_.on_mismatch == OnMismatch::warn)
      return;
    std::size_t reads = 0;
    std::size_t asked = 0;
    for (const auto& entry : tape_.entries()) {
      if (reads >= session_.size()) break;
      if (entry.kind == RecordKind::write) asked += entry.data.size();
      if (entry.kind != RecordKind::read || entry.data.empty()) continue;
      reads += entry.data.size();
      require(written_.size() >= asked && written_.compare(0, asked, writes_, 0, asked) == 0,
              "no answer before its question");
    }
  }

  [[nodiscard]] bool lookup() const { return config_.match == Match::lookup; }
  // What comes to the driver comes in the tape's order.
  [[nodiscard]] bool ordered() const { return !lookup() && config_.on_mismatch != OnMismatch::resync; }

  void check_parts(const ReplayActions& actions) {
    std::size_t begin = 0;
    for (const std::size_t end : actions.block_ends) {
      const std::string_view part = as_text(actions.deliver).substr(begin, end - begin);
      require(reads_.find(part) != std::string::npos, "an arrival is a stretch of the tape");
      begin = end;
    }
  }

  void check_lookup(const RunReport& report) {
    const LookupReport& told = *report.lookup;
    require(told.asked <= told.requests && told.asked <= told.answered, "what was asked for is on the tape");
    require(told.never_asked.size() ==
                std::min<std::uint64_t>(told.requests - told.asked, LookupReport::kMostListed),
            "what was never asked for is listed");
    require(report.verdict != Verdict::pass || config_.strictness == 0 || told.unknown == 0,
            "a pass has nothing unknown");
  }

  void check(const RunReport& report) {
    require(report.from_driver_matched <= report.from_driver_bytes, "what matched was written");
    require(lookup() || steered_ || report.from_driver_matched <= report.from_driver_of,
            "what matched is on the tape");
    require(report.lookup.has_value() == lookup(), "what was asked for is told under lookup");
    if (lookup()) check_lookup(report);
    require(steered_ || (report.to_driver_of == reads_.size() && report.from_driver_of == writes_.size()),
            "totals are the tape's");
    require(report.to_driver_bytes == delivered_, "every delivery is counted");
    const SettingsReport& settings = report.settings;
    const std::uint64_t missing = settings.recorded - settings.made;
    require(settings.made <= settings.recorded, "what was made was recorded");
    require(settings.missing.size() == std::min<std::uint64_t>(missing, SettingsReport::kMostMissing),
            "what was not made is told");
    require(report.verdict != Verdict::settings_mismatch || (config_.check_settings && missing > 0),
            "only settings that are checked and missing are a mismatch");
    require(config_.strictness > 0 || report.verdict == Verdict::pass ||
                report.verdict == Verdict::settings_mismatch,
            "strictness 0 passes");
    require(report.verdict != Verdict::pass || config_.strictness == 0 || lookup() || steered_ ||
                report.from_driver_matched == writes_.size(),
            "a pass has all writes");
    require((report.mismatches > 0) == report.mismatch.has_value(), "the first mismatch is there");
    // A quarter of the time, were it each report.
    if (!std::exchange(told_, true))
      require(!to_text(report).empty() && !to_json(report).empty(), "a report has a text");
    running_ = false;
    written_.clear();
    delivered_ = 0;
    session_.clear();
  }

  const MemoryTape& tape_;
  ReplayConfig config_;
  TapePart part_;
  bool steered_;  // not all of the tape once and in order
  bool stands_ = false;
  bool sessions_;
  bool shows_signals_;
  std::string reads_;
  std::string writes_;
  MemorySource merged_;
  MemorySource writes_alone_;
  PartOfTape schedule_;
  PartOfTape write_source_;
  MemorySource index_;
  MemoryAnswers answers_;
  Engine engine_;
  Instant now_{Micros{1'000'000}};
  bool open_ = false;
  bool blocked_ = false;
  bool running_ = false;  // a run may be going on
  bool told_ = false;     // a report was, as text
  std::string session_;   // delivered since the open
  std::string written_;   // in this run
  std::size_t delivered_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Choices input(data, size);
  const ReplayConfig config = make_config(input);
  const bool sessions = input(2) == 1;
  const bool signals = input(3) == 0;
  const std::size_t piece = 1 + input(9);
  const MemoryTape tape = random_tape(input, {.sessions = sessions,
                                              .hang_ups = sessions,
                                              .half_closes = sessions,
                                              .gaps = input(2) == 1,
                                              .signals = signals,
                                              .max_records = 40});
  Play(tape, config, sessions, signals, piece).run(input);
  return 0;
}
