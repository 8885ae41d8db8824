#include "libport/infer/infer.hpp"

#include <algorithm>
#include <cstdint>
#include <fmt/format.h>

#include "libport/infer/findings.hpp"
#include "libport/infer/proposal.hpp"
#include "libport/rules/rule_expectation.hpp"

namespace porttape {
namespace {

constexpr int kMostRounds = 8;
constexpr std::size_t kShown = 24;
// For each byte of the tapes, and for whatever tapes. A look takes some 300 ns.
constexpr std::uint64_t kLooksForByte = 1;
constexpr std::uint64_t kLooksMore = 15'000'000;

std::string counted(std::size_t count, std::string_view noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

// The frame that has the byte at `offset` of a session, as one that may be left out; false: it is one
// already, or no frame.
bool loosen(Findings& findings, const SessionTape& session, std::size_t offset) {
  const Byte* place = session.writes.data() + offset;
  for (FoundKind& kind : findings.kinds) {
    for (const FrameRun& run : kind.runs) {
      for (const ByteView frame : run) {
        if (place < frame.data() || place >= frame.data() + frame.size()) continue;
        const auto same = [&](ByteView other) { return other.data() == frame.data(); };
        if (std::ranges::any_of(kind.alone, same)) return false;
        kind.alone.push_back(frame);
        return true;
      }
    }
  }
  return false;
}

// Lets the frames where a tape stops to pass against another come or be left out. False: that changes
// nothing.
bool loosen(Findings& findings, std::span<const SessionTape> sessions, std::span<const Proof::Pair> pairs) {
  bool changed = false;
  for (const Proof::Pair& pair : pairs) {
    if (!pair.difference || pair.difference->given_up) continue;
    const SessionTape& recorded = sessions[pair.recorded];
    const SessionTape& came = sessions[pair.came];
    if (pair.difference->recorded < recorded.writes.size())
      changed = loosen(findings, recorded, pair.difference->recorded) || changed;
    if (pair.difference->came < came.writes.size())
      changed = loosen(findings, came, pair.difference->came) || changed;
  }
  return changed;
}

// Takes away, one after the other, the permissions that no tape needs.
void tighten(RuleSet& rules, std::span<const SessionTape> sessions, Looks& looks) {
  const auto passes = [&](const RuleSet& tried) {
    Proof proof;
    proof.pairs = hold_all(RuleExpectation(tried), sessions, looks);
    return proof.passes();
  };
  for (std::size_t i = 0; i < rules.rules.size(); ++i) {
    for (bool Rule::*flag : {&Rule::optional, &Rule::repeated}) {
      if (!(rules.rules[i].*flag)) continue;
      RuleSet tried = rules;
      tried.rules[i].*flag = false;
      if (passes(tried)) rules = std::move(tried);
    }
  }
  std::erase_if(rules.rules, [](const Rule& rule) {
    return rule.kind == Rule::Kind::frame && !rule.optional && !rule.repeated;
  });
}

bool are_alike(const Findings& findings) {
  const auto common =
      std::ranges::count_if(findings.kinds, [](const FoundKind& kind) { return kind.in_all; });
  return 2 * static_cast<std::size_t>(common) >= findings.kinds.size();
}

void tell_left_out(const Findings& findings, std::span<const SessionTape> sessions, Inference& inference) {
  if (!inference.alike)
    inference.unexplained.push_back(
        "these tapes have little in common: are they of one session of one driver?");
  if (findings.other_bytes > 0)
    inference.unexplained.push_back(
        fmt::format("{} of no frame: compared as they are", counted(findings.other_bytes, "byte")));
  if (findings.left_out > 0)
    inference.unexplained.push_back(
        fmt::format("{} at the ends of long tapes: not looked at for what varies, but held against the rules",
                    counted(findings.left_out, "frame")));
  for (const SessionTape& session : sessions)
    if (session.gaps)
      inference.unexplained.push_back(
          fmt::format("{} has a gap: what is missing there counts as never written", session.name));
  for (const FoundSort& sort : findings.sorts)
    if (!sort.sort.format.checksum && sort.sort.format.kind != FrameFormat::Kind::fixed)
      inference.unexplained.push_back(
          fmt::format("frame {}: no checksum of the catalogue is right in all frames: none is taken for one",
                      sort.sort.format.name.for_line()));
}

std::string place_text(const SessionTape& session, std::size_t offset) {
  const ByteView rest = ByteView(session.writes).subspan(std::min(offset, session.writes.size()));
  return fmt::format("byte {} of what {} wrote: {}", offset, session.name, text_and_hex(rest, kShown));
}

std::uint64_t looks_for(std::span<const SessionTape> sessions) {
  std::uint64_t looks = kLooksMore;
  for (const SessionTape& session : sessions)
    looks += kLooksForByte * (session.writes.size() + session.reads.size());
  return looks;
}

}  // namespace

bool need_no_rules(std::span<const SessionTape> sessions) {
  return std::ranges::all_of(
      sessions, [&](const SessionTape& session) { return session.writes == sessions.front().writes; });
}

Inference infer_rules(std::span<const SessionTape> sessions, const ProofLimits& limits) {
  Looks looks(limits.looks.value_or(looks_for(sessions)));
  Findings findings = find_differences(sessions);
  Inference inference;
  inference.frames = findings.why;
  inference.alike = are_alike(findings);
  Proposal proposal = propose(findings);
  for (int round = 0; round < kMostRounds; ++round) {
    const auto pairs = hold_all(RuleExpectation(proposal.rules), sessions, looks);
    if (!loosen(findings, sessions, pairs)) break;
    proposal = propose(findings);
  }
  inference.rules = std::move(proposal.rules);
  inference.reasons = std::move(proposal.reasons);
  inference.proof = prove(RuleExpectation(inference.rules), sessions, limits, looks);
  if (inference.proof.passes() && inference.proof.missed_count > 0) {
    tighten(inference.rules, sessions, looks);
    inference.proof = prove(RuleExpectation(inference.rules), sessions, limits, looks);
  }
  tell_left_out(findings, sessions, inference);
  return inference;
}

std::vector<std::string> proof_text(const Proof& proof, std::span<const SessionTape> sessions) {
  std::vector<std::string> lines;
  const auto passed = std::ranges::count_if(proof.pairs, [](const auto& pair) { return !pair.difference; });
  lines.push_back(fmt::format("each tape held against each: {} of {} pass", passed, proof.pairs.size()));
  for (const Proof::Pair& pair : proof.pairs) {
    if (!pair.difference) continue;
    if (pair.difference->given_up) {
      lines.push_back(fmt::format("  {} against {}: not known, given up at byte {} of what {} wrote",
                                  sessions[pair.came].name, sessions[pair.recorded].name,
                                  pair.difference->came, sessions[pair.came].name));
      continue;
    }
    lines.push_back(fmt::format(
        "  {} against {}: stops at {}; recorded there: {}", sessions[pair.came].name,
        sessions[pair.recorded].name, place_text(sessions[pair.came], pair.difference->came),
        text_and_hex(ByteView(sessions[pair.recorded].writes)
                         .subspan(std::min(pair.difference->recorded, sessions[pair.recorded].writes.size())),
                     kShown)));
  }
  lines.push_back(fmt::format(
      "one byte changed at a time: {} changes of {} of the {} bytes that may not vary; {} not found; {} may "
      "vary",
      proof.tried * Proof::kChanges, proof.tried == proof.bytes ? "all" : fmt::format("{}", proof.tried),
      proof.bytes, proof.missed_count, counted(proof.inside, "byte")));
  if (proof.given_up)
    lines.emplace_back(
        "given up: so many rules for so many frames take too long to prove; give shorter tapes, or "
        "tapes that are more alike");
  for (const Proof::Missed& missed : proof.missed)
    lines.push_back(fmt::format("  not found: {:02x} instead of {:02x} at {}", missed.became, missed.was,
                                place_text(sessions[missed.tape], missed.at)));
  return lines;
}

}  // namespace porttape
