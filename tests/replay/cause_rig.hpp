#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/replay/cause.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/report.hpp"
#include "tests/replay/rig.hpp"
#include "tests/support/memory_tape.hpp"

// Runs against a tape of requests and answers, and what their reports say of the reason.
namespace porttape::test::causes {

constexpr std::int64_t kPace = 100'000;

// A request every 100 ms, each answered 20 ms later.
inline MemoryTape tape_of(const std::vector<std::string>& requests) {
  MemoryTape tape;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const auto at = static_cast<std::int64_t>(i) * kPace;
    tape.write(at, requests[i]).read(at + 20'000, "answer " + std::to_string(i + 1) + "\n");
  }
  return tape;
}

inline MemoryTape laser() { return tape_of({"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n", "QT\n"}); }

inline ReplayConfig config(int strictness = 1) {
  ReplayConfig config;
  config.strictness = strictness;
  config.on_mismatch = OnMismatch::fail;
  return config;
}

inline void look(RunReport& report, const MemoryTape& tape) {
  MemorySource source(tape);
  if (const auto place = place_of_fault(report))
    report.excerpt = std::make_shared<const TapeExcerpt>(read_excerpt(source, *place, kFrameGap).value());
  diagnose(report);
}

// A driver that writes so, each once the last was answered; what follows a mismatch is in one piece.
inline RunReport after(const MemoryTape& tape, const std::vector<std::string>& writes,
                       bool answered = false) {
  Rig rig(tape, config());
  rig.open();
  std::string followed;
  for (const std::string& write : writes) {
    if (rig.report) followed += write;
    rig.write(write).wait(kPace);
  }
  if (!rig.report) rig.close();
  RunReport report = rig.report.value();
  if (report.mismatch) {
    const ByteView more = as_bytes(followed);
    report.mismatch->came.insert(report.mismatch->came.end(), more.begin(), more.end());
    report.mismatch->answered = answered;
  }
  look(report, tape);
  return report;
}

inline Cause cause(const RunReport& report) { return report.diagnosis.cause.value_or(Cause{.text = "none"}); }

inline std::string text(const MemoryTape& tape, const std::vector<std::string>& writes) {
  return cause(after(tape, writes)).text;
}

// Modbus: address, function, register, count, CRC.
inline MemoryTape modbus() {
  return tape_of({std::string("\x01\x03\x00\x00\x00\x02\xc4\x0b", 8),
                  std::string("\x01\x03\x00\x10\x00\x01\x85\xcf", 8),
                  std::string("\x01\x06\x00\x01\x00\x17\x98\x04", 8)});
}

}  // namespace porttape::test::causes
