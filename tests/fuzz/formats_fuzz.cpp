// Forms of a tape that are read. The first line names the form, behind a byte that chooses the options; the
// rest is the evidence. What is taken is a tape, whose text is one again and the same. What is not taken has
// an error with a text.

#include <memory>
#include <string>
#include <utility>

#include "libport/formats/dialect.hpp"
#include "libport/formats/format.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

// Keeps the bytes of a tape's file.
class MemorySink final : public TapeSink {
 public:
  explicit MemorySink(Bytes& bytes) : bytes_(bytes) {}
  Appended append(ByteView head, ByteView body) override {
    porttape::append(bytes_, head);
    porttape::append(bytes_, body);
    return {head.size() + body.size(), 0};
  }
  int truncate(std::uint64_t size) override {
    bytes_.resize(size);
    return 0;
  }
  Sync syncer() override {
    return [] { return 0; };
  }
  int close() override { return 0; }

 private:
  Bytes& bytes_;
};

struct MadeTape {
  Bytes read;
  Bytes write;
  Bytes events;
};

// False: it is not taken.
bool import_from(const Format& format, std::string_view evidence, const ImportOptions& options,
                 MadeTape& made) {
  TapeSinks sinks{std::make_unique<MemorySink>(made.read), std::make_unique<MemorySink>(made.write),
                  std::make_unique<MemorySink>(made.events)};
  Evidence from = Evidence::of("evidence", evidence);
  ImportTape tape(std::move(sinks), options, "evidence");
  const auto end = format.import_tape(from, tape, {});
  if (!end) {
    require(!end.error().message.empty(), "an error has a text");
    return false;
  }
  return static_cast<bool>(tape.finish(*end));
}

std::string text_of(const MadeTape& made) {
  const auto source = [](const Bytes& bytes) { return std::make_unique<MemorySource>("file", bytes); };
  auto reader = TapeReader::from_sources({source(made.read), source(made.write), source(made.events)});
  require(reader.has_value(), "what was made is a tape");
  NewFile text = NewFile::in_memory();
  const auto lost = find_format("text")->export_tape(*reader, text, {});
  require(lost.has_value(), "it is sound to its end");
  require(text.finish().has_value(), "memory takes all");
  return text.take();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view input(reinterpret_cast<const char*>(data), size);
  const std::size_t line = input.find('\n');
  if (line == 0 || line == std::string_view::npos) return 0;
  const std::string_view evidence = input.substr(line + 1);
  (void)detect_format(evidence, "");
  const std::string_view name = input.substr(1, line - 1);
  if (name == "dialect") {
    if (const auto dialect = Dialect::parse(std::string(evidence), "d.toml"))
      (void)dialect->find(evidence.substr(0, 200));
    return 0;
  }
  const Format* named = find_format(name);
  const Format& format = named != nullptr ? *named : formats()[line % formats().size()];
  if (format.import_tape == nullptr) return 0;
  ImportOptions options;
  options.swapped = (data[0] & 0x80U) != 0;
  if ((data[0] & 0x40U) != 0) options.lead = Micros(2'000'000);
  if ((data[0] & 0x20U) != 0) options.bytes_at = 9600;
  MadeTape made;
  if (!import_from(format, evidence, options, made)) return 0;
  const std::string text = text_of(made);
  MadeTape again;
  require(import_from(*find_format("text"), text, {}, again), "its text is taken");
  require(text_of(again) == text, "its text says the same");
  return 0;
}
