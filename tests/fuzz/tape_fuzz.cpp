// Any bytes as a tape: two little-endian 16-bit numbers, the sizes of the r and the w file, and then the r, w
// and e file. What is checked: no crash, an end, pieces that add up, a second pass that gives the same, and
// that the summary and the judgement agree.

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "libport/tape/judgement.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace {

using namespace porttape;
using test::require;

struct Files {
  Bytes read;
  Bytes write;
  Bytes events;
};

Files split(ByteView input) {
  if (input.size() < 4) return {};
  const std::size_t read = input[0] + input[1] * std::size_t{256};
  const std::size_t write = input[2] + input[3] * std::size_t{256};
  input = input.subspan(4);
  const auto part = [&](std::size_t size) {
    const ByteView bytes = input.first(std::min(size, input.size()));
    input = input.subspan(bytes.size());
    return Bytes(bytes.begin(), bytes.end());
  };
  Files files;
  files.read = part(read);
  files.write = part(write);
  files.events = part(input.size());
  return files;
}

TapeSources sources_of(const Files& files) {
  TapeSources sources{std::make_unique<MemorySource>("r", files.read),
                      std::make_unique<MemorySource>("w", files.write), nullptr};
  if (!files.events.empty()) sources.events = std::make_unique<MemorySource>("e", files.events);
  return sources;
}

struct Pass {
  std::uint64_t records = 0;
  std::uint64_t bytes = 0;
  std::uint64_t blocks = 0;
  std::optional<Error> error;

  friend bool operator==(const Pass&, const Pass&) = default;
};

Pass read_through(TapeReader& reader) {
  Pass pass;
  TapeTime last{};
  for (;;) {
    const auto record = reader.next();
    if (!record) {
      pass.error = record.error();
      require(!reader.next(), "an error comes again");
      return pass;
    }
    if (!*record) return pass;
    require((**record).at >= last, "time does not go back");
    last = (**record).at;
    ++pass.records;
    if ((**record).kind == RecordKind::read || (**record).kind == RecordKind::write) {
      require((**record).piece_offset + (**record).data.size() <= (**record).block_length, "pieces add up");
      pass.bytes += (**record).data.size();
      pass.blocks += (**record).last_piece() ? 1U : 0U;
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Files files = split({data, size});
  const auto summary = summarize("t", sources_of(files));
  auto reader = TapeReader::from_sources(sources_of(files));
  if (!reader) {
    const bool is_damage =
        summary && reader.error().code == Errc::damaged_tape && !summary->damages().empty();
    require(!summary || is_damage, "what the reader refuses is no tape, or damage");
    return 0;
  }
  require(summary.has_value(), "summary and reader take the same tapes");
  const Pass first = read_through(*reader);
  require(reader->rewind().has_value(), "a tape can be read again");
  require(read_through(*reader) == first, "a second pass gives the same");
  const Judgement judgement = judge(*summary);
  require(judgement.damages.empty() == !first.error, "judgement and reader see the same damage");
  require((judgement.verdict == Judgement::Verdict::damaged) == !judgement.damages.empty(),
          "damage is judged so");
  require(judgement.damages.size() >= summary->damages().size(), "every damage is judged");
  require(judgement.verdict != Judgement::Verdict::sound || summary->torn_tails().empty(),
          "no torn tape is sound");
  if (!first.error) {
    require(summary->read.bytes + summary->write.bytes == first.bytes, "bytes add up");
    require(summary->read.blocks + summary->write.blocks == first.blocks, "blocks add up");
    require(summary->torn_tails().empty() == !reader->torn_tail(),
            "summary and reader see the same torn tail");
  }
  return 0;
}
