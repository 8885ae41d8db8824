#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "libport/rules/filler.hpp"
#include "libport/rules/redact_stream.hpp"
#include "libport/tape/event_texts.hpp"
#include "libport/tape/part_writer.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// What was replaced on a tape; never what stood there.
struct TapeRedaction {
  enum class Where : std::uint8_t { read, write, event, header };
  Where where = Where::read;
  TapeTime at{};             // of the block in which it begins, or of the event
  std::uint64_t offset = 0;  // read, write: in the stream; event, header: in the text
  std::uint64_t length = 0;
  int rule = Redaction::kFollows;  // of the set's redactions
  std::string key{};               // event, header: the text's, redacted itself
};

// What holds something to be hidden and cannot be replaced: a number, a key's name, an event's kind.
struct UnredactedText {
  TapeRedaction::Where where = TapeRedaction::Where::event;  // or header
  TapeTime first{};                                          // of its event
  std::uint64_t count = 0;
  FixedText what = FixedText::number;
  std::string key{};  // the number's, the name itself or the kind: redacted
  int rule = 0;
};

struct RedactOptions {
  RuleSet rules;
  Filler::Key key{};      // random
  bool identity = false;  // header and events do not say which machine and which device this was
  bool dry_run = false;   // nothing is made
  TapeWriterOptions writer;
  TapeProgress progress;
  std::function<void(const TapeRedaction&)> on_redaction;  // stream by stream, in each by place
};

struct RedactedTape {
  struct Use {
    std::uint64_t count = 0;
    std::uint64_t bytes = 0;
    std::optional<TapeRedaction> first{};
  };
  TapePaths paths;
  std::vector<Use> rules;  // as in the set
  Use follows;             // checksums and lengths of frames
  std::uint64_t wrong_checksums = 0;
  std::vector<UnredactedText> left{};  // each once, the first 64
  bool identity_gone = false;
  std::optional<std::string> torn_tail{};  // or which file of a tape without events is missing
};

// Makes a tape of another without its secrets: as many blocks, as long, at the same times. Errc::usage also
// where a secret is longer than its rule can see; else as TapeReader and NewTape.
Result<RedactedTape> redact_tape(const TapePaths& from, const TapePaths& to, const RedactOptions& options);

}  // namespace porttape
