#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "libport/infer/proof.hpp"
#include "libport/infer/session_tape.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// Rules that several tapes of one session give, with what speaks for them.
struct Inference {
  RuleSet rules{};
  std::string frames{};                    // what the writes were taken for
  std::vector<std::string> reasons{};      // for each rule and checksum
  std::vector<std::string> unexplained{};  // what no rule was found for, or was left out
  bool alike = true;                       // most kinds of frames stand at the same places in all tapes
  Proof proof{};

  [[nodiscard]] bool proven() const { return alike && proof.holds(); }
};

// Whether the driver wrote the same bytes in all tapes: each passes against each without rules.
bool need_no_rules(std::span<const SessionTape> sessions);

// From the writes of at least two tapes. What the tapes do not hold to is loosened until each tape passes
// against each one, or no more is left to loosen; then the proof says so.
Inference infer_rules(std::span<const SessionTape> sessions, const ProofLimits& limits = {});

// The proof for a person: a line for each thing that was tried.
std::vector<std::string> proof_text(const Proof& proof, std::span<const SessionTape> sessions);

}  // namespace porttape
