#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/catalog/channel.hpp"
#include "tests/simulation/tape_script.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// What the driver of a replayed tape does otherwise than the recorded one did.
struct Mistake {
  enum class Kind : std::uint8_t {
    none,
    byte,      // one of a write is another
    missing,   // a write's end is left out
    extra,     // a write has one byte more
    trailing,  // one byte more behind the last write
    settings,  // another rate is set
    time,      // a write comes too early or too late
    early      // it leaves before a write
  };
  Kind kind = Kind::none;
  std::size_t item = 0;      // of the tape
  std::size_t byte = 0;      // of the item's
  std::uint64_t offset = 0;  // of that byte in all that the driver writes
  Nanos time{};              // how much later
};

std::string_view name_of(Mistake::Kind kind);

// What the driver writes too much.
constexpr Byte kExtraByte{0x55};

// A recorded read as it is to come.
struct Answer {
  std::size_t item = 0;   // its place on the tape
  std::size_t begin = 0;  // its place in what the device sent
  std::size_t end = 0;
  Micros at{};               // its time on the tape, of its arrival's first block
  std::size_t gate = 0;      // the item that it is timed from
  std::size_t exchange = 0;  // which: the driver's writes begin them
};

// A tape, how it is replayed, and how its driver behaves: by chance.
class ReplayPlan {
 public:
  struct Circumstances {
    // Another channel's disk may hold the loop up, so that what is due comes late.
    bool stalls = false;
    // The driver reads at once, and its line takes all.
    bool hurries = false;
    bool half_closes = false;  // the driver's line has them
  };

  ReplayPlan(World& world, const Circumstances& circumstances);

  // The channel's options, less its ports and files.
  [[nodiscard]] OptionValues options() const;
  [[nodiscard]] std::string to_text() const;

  [[nodiscard]] const TapeScript& script() const { return script_; }
  // The time of a tape's item, less what max-gap cuts.
  [[nodiscard]] Micros time_of(std::size_t item) const { return times_[item]; }
  [[nodiscard]] const std::vector<Answer>& answers() const { return answers_; }
  [[nodiscard]] bool is_behind_gap(const Answer& answer) const;

  [[nodiscard]] int strictness() const { return strictness_; }
  [[nodiscard]] const std::string& timing() const { return timing_; }
  [[nodiscard]] double rate() const { return rate_; }
  [[nodiscard]] bool checks_settings() const { return checks_settings_; }
  [[nodiscard]] bool starts_paused() const { return starts_paused_; }
  [[nodiscard]] bool resyncs() const { return on_mismatch_ == "resync"; }
  // Answers are found by what the driver asks (match=lookup).
  [[nodiscard]] bool looks_up() const { return looks_up_; }
  // By lookup a request that begins another one is complete at a pause, or when what follows does not go on
  // with the longer one: the driver's pauses decide which it is.
  [[nodiscard]] bool pauses_decide() const { return pauses_decide_; }
  [[nodiscard]] bool goes_on_at_end() const { return at_end_ == "idle"; }
  [[nodiscard]] Nanos jitter() const { return jitter_; }
  // What comes is timed from what the driver writes.
  [[nodiscard]] bool is_gated() const { return timing_ != "recorded"; }
  // The driver has to write at the recorded times.
  [[nodiscard]] bool is_punctual() const { return strictness_ == 2; }
  [[nodiscard]] bool has_pieces() const { return chunks_ == "bytes" || chunks_.starts_with("random"); }

  [[nodiscard]] bool hurries() const { return circumstances_.hurries; }
  [[nodiscard]] bool stalls() const { return circumstances_.stalls; }
  // The driver does not wait for answers before it writes.
  [[nodiscard]] bool writes_ahead() const { return writes_ahead_; }
  [[nodiscard]] const Mistake& mistake() const { return mistake_; }
  [[nodiscard]] bool as_recorded() const { return mistake_.kind == Mistake::Kind::none; }
  // Rules let the number of each frame vary (--rules): the driver writes others than were recorded.
  [[nodiscard]] bool is_ruled() const { return ruled_; }
  // And a frame of an answer has the number of its request.
  [[nodiscard]] bool echoes() const { return echoes_; }
  [[nodiscard]] std::string rules() const;
  // What the driver writes for the tape's item, and what the device is to send in all.
  [[nodiscard]] Bytes written(std::size_t item) const;
  [[nodiscard]] const Bytes& reads() const { return reads_; }
  // A write with the driver's mistake.
  [[nodiscard]] Bytes mistaken(Bytes data) const;
  // By lookup: what the driver writes by mistake is made of requests of the tape, or of nothing.
  [[nodiscard]] bool mistake_is_asked() const;
  // How often the user steers the replay.
  [[nodiscard]] std::int64_t controls() const { return controls_; }

 private:
  void cut_gaps();
  void find_answers();
  [[nodiscard]] std::vector<Bytes> requests(bool wrong) const;
  [[nodiscard]] bool one_request_begins_another() const;
  void choose_mistake(World& world);
  void choose_rules();
  [[nodiscard]] bool mistake_spares_frames() const;
  void find_reads();

  Circumstances circumstances_;
  int strictness_ = 1;
  std::string timing_ = "reactive";
  double rate_ = 1;
  std::string chunks_ = "auto";
  std::string on_mismatch_ = "warn";
  std::string at_end_ = "idle";
  std::optional<Micros> max_gap_ = {};
  bool checks_settings_ = false;
  bool looks_up_ = false;
  bool pauses_decide_ = false;
  bool starts_paused_ = false;
  Nanos jitter_ = std::chrono::milliseconds(100);
  bool writes_ahead_ = false;
  std::int64_t controls_ = 0;
  TapeScript script_;
  std::vector<Micros> times_;
  std::vector<Answer> answers_;
  Mistake mistake_;
  bool ruled_ = false;
  bool echoes_ = false;
  Bytes reads_;
};

// Nanoseconds.
inline double nanos(Micros time) {
  return static_cast<double>(std::chrono::duration_cast<Nanos>(time).count());
}

}  // namespace porttape::simulation
