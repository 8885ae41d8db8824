#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "libport/tape/tape_summary.hpp"

namespace porttape {

// What can be said of a tape's state. FORMAT.md, "Sound or not".
struct Judgement {
  enum class Verdict : std::uint8_t {
    sound,      // whole, and each file is what the `end` event tells of
    unchecked,  // the same as far as it can be seen; a note says what could not be checked
    flawed,  // no damage found, but notes say what is missing or not known (a gap, no end, a torn tail, …)
    damaged
  };

  Verdict verdict = Verdict::sound;
  std::vector<std::string> damages;  // what is wrong, each with the file's name
  std::vector<std::string> notes;    // what else a person should know

  // Nothing speaks against it.
  [[nodiscard]] bool sound() const { return verdict == Verdict::sound || verdict == Verdict::unchecked; }
};

Judgement judge(const TapeSummary& tape);

// For a person: "sound", "no damage found, as far as it can be checked", "no damage found", "damaged".
std::string_view words_of(Judgement::Verdict verdict);
// For a program: "sound", "unchecked", "no-damage-found", "damaged".
std::string_view to_string(Judgement::Verdict verdict);

}  // namespace porttape
