// Events files. The first byte chooses: an event or a header put together out of the rest and encoded; or the
// rest as one line of a file, or as a whole file. What was encoded decodes to what it was, a key that is not
// known changes nothing, times never go back, and a second pass gives the same.

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/json_text.hpp"
#include "libport/tape/event_file.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

constexpr std::size_t kLongest = 4096;  // bytes of a text that a tape keeps

constexpr std::uint64_t kTimes = std::uint64_t{1} << 63U;  // microseconds from 0 on that a tape has

// An event or a header out of the input.
class Maker {
 public:
  explicit Maker(Input& input) : input_(input) {}

  Event event() {
    switch (input_(16)) {
      case 0:
        return event::Open{};
      case 1:
        return event::Close{};
      case 2:
        return event::DeviceLost{text(), flag()};
      case 3:
        return event::DeviceBack{};
      case 4:
        return event::HalfClose{word<Side>(2)};
      case 5:
        return event::Zero{zero()};
      case 6:
        return event::Flush{word<FlushQueue>(3)};
      case 7:
        return event::Mark{text()};
      case 8:
        return event::Gap{number(), flag() ? std::optional(time()) : std::nullopt, text()};
      case 9:
        return event::End{totals(), totals()};
      case 10:
        return event::Settings{word<Side>(2), settings(), word<SettingsOrder>(2)};
      case 11:
        return event::Fault{fault()};
      case 13:
        return event::Modem{word<LineSignal::Name>(6), word<bool>(2), word<Side>(2)};
      case 14:
        return event::Break{word<bool>(2), word<Side>(2)};
      case 15:
        return event::Drain{Micros{static_cast<std::int64_t>(number())}};
      default:
        return event::Unknown{"x" + text()};  // no kind begins so
    }
  }

  TapeHeader header() {
    TapeHeader header;
    for (StrangerText* member :
         {&header.device, &header.driver, &header.created, &header.host, &header.tool, &header.id})
      *member = text();
    if (flag()) header.zero = zero();
    header.transport = word<Transport>(2);
    header.stamped = word<Stamped>(2);
    if (flag()) header.previous = PreviousTape{text(), text()};
    return header;
  }

  // No event has the latest one.
  TapeTime time() { return tape_time_us(static_cast<std::int64_t>(number() % (kTimes - 1))); }

  // Whether a tape keeps every text as it is.
  [[nodiscard]] bool exact() const { return utf8_ && short_; }
  // Whether it keeps what it has made of it: what is no UTF-8 grows, and may then be too long.
  [[nodiscard]] bool stable() const { return utf8_ || short_; }

 private:
  bool flag() { return input_(2) == 1; }
  std::uint64_t number() { return input_.number() % kTimes; }

  std::string text() {
    std::string text = input_.text();
    if (input_(16) == 15) {
      const std::string piece = text.empty() ? "\xC3\xA4" : text;
      while (text.size() <= kLongest) text += piece;
    }
    short_ = short_ && text.size() <= kLongest / 3;
    utf8_ = utf8_ && to_utf8(text) == text;
    return text;
  }

  template <class Word>
  std::optional<Word> word(std::uint32_t words) {
    const std::uint32_t chosen = input_(words + 1);
    return chosen == words ? std::nullopt : std::optional(static_cast<Word>(chosen));
  }

  SeenSettings settings() {
    SeenSettings line;
    if (flag()) line.baud = static_cast<unsigned>(number());
    if (flag()) line.data_bits = 5 + input_(4);
    line.parity = word<Parity>(5);
    if (flag()) line.stop_bits = 1 + input_(2);
    if (flag()) line.hw_flow = flag();
    if (flag()) line.sw_flow = flag();
    return line;
  }

  LineFault fault() {
    LineFault fault;
    fault.kind = text();
    fault.spec = text();
    fault.dir = word<LineDir>(2);
    if (flag()) fault.offset = number();
    fault.count = number();
    if (flag()) fault.seed = number();
    return fault;
  }

  TapeZero zero() { return {text(), to_us(time()), text()}; }

  std::optional<PayloadTotals> totals() {
    if (!flag()) return std::nullopt;
    return PayloadTotals{number(), number(), flag() ? std::optional(input_.number()) : std::nullopt};
  }

  Input& input_;
  bool utf8_ = true;
  bool short_ = true;
};

// Checks.

std::string_view without_newline(const std::string& line) {
  require(line.ends_with('\n') && line.find('\n') == line.size() - 1, "an event is one line");
  return std::string_view(line).substr(0, line.size() - 1);
}

TapeEvent decoded(TapeTime at, const Event& event) {
  const std::string line = encode(at, event);
  Result<TapeEvent> read = decode_event(without_newline(line));
  require(read.has_value(), "what was encoded can be decoded");
  require(read->at == at, "the time is kept");
  return std::move(*read);
}

TapeHeader decoded(const TapeHeader& header) {
  const std::string line = encode(header);
  Result<TapeHeader> read = decode_header(without_newline(line));
  require(read.has_value(), "a header that was encoded can be decoded");
  return std::move(*read);
}

// The same object with keys that nobody knows, before and behind the others.
std::string with_unknown_keys(std::string_view object) {
  const std::size_t begin = object.find('{');
  const std::size_t end = object.rfind('}');
  const std::string_view members = object.substr(begin + 1, end - begin - 1);
  const bool none = members.find_first_not_of(" \t\r\n") == std::string_view::npos;
  return std::string("{\"zz-first\":{\"t_us\":-1,\"event\":[null]}").append(none ? "" : ",").append(members) +
         ",\"zz-last\":1e300}";
}

void check_line(std::string_view line) {
  if (const Result<TapeEvent> read = decode_event(line)) {
    require(read->at >= TapeTime{}, "no time is before the tape's begin");
    const TapeEvent again = decoded(read->at, read->what);
    require(decoded(again.at, again.what).what == again.what, "an event that was read can be kept");
    const Result<TapeEvent> with_more = decode_event(with_unknown_keys(line));
    require(with_more && with_more->at == read->at && with_more->what == read->what,
            "a key that is not known changes nothing");
  } else {
    require(read.error().code == Errc::damaged_tape && !read.error().message.empty(),
            "a line that is no event is damage");
  }
  if (const Result<TapeHeader> header = decode_header(line)) {
    const TapeHeader again = decoded(*header);
    require(decoded(again) == again, "a header that was read can be kept");
    const Result<TapeHeader> with_more = decode_header(with_unknown_keys(line));
    require(with_more && *with_more == *header, "a key that is not known changes no header");
  } else {
    require(header.error().code == Errc::not_a_tape || header.error().code == Errc::damaged_tape,
            "a line that is no header is no tape's");
  }
}

struct Pass {
  std::vector<std::string> lines;
  EventFile::Step last = EventFile::Step::end;
  std::optional<std::string> torn;
  std::optional<TapeHeader> header;

  friend bool operator==(const Pass&, const Pass&) = default;
};

Pass read_through(EventFile& file) {
  Pass pass;
  TapeTime last{};
  while ((pass.last = file.next()) == EventFile::Step::event) {
    require(file.header().has_value(), "no event without a header");
    require(file.event().at >= last, "time does not go back");
    last = file.event().at;
    const Result<TapeEvent> alone = decode_event(file.line());
    require(alone && alone->at == last && alone->what == file.event().what, "an event is its line's");
    pass.lines.emplace_back(file.line());
  }
  require(file.next() == pass.last, "an end and a failure come again");
  pass.torn = file.torn_tail();
  pass.header = file.header();
  return pass;
}

void check_file(std::string_view text) {
  const ByteView bytes = as_bytes(text);
  auto file = EventFile::create(std::make_unique<MemorySource>("e", Bytes(bytes.begin(), bytes.end())));
  if (!file)
    return require(file.error().code == Errc::not_a_tape || file.error().code == Errc::damaged_tape,
                   "no events file is no tape's");
  const Pass first = read_through(*file);
  require(first.last == EventFile::Step::failed ||
              first.torn.has_value() == (!text.empty() && text.back() != '\n'),
          "an unfinished last line is told");
  file->rewind();
  require(read_through(*file) == first, "a second pass gives the same");
}

void check_event(Input& input) {
  Maker maker(input);
  const TapeTime at = maker.time();
  const Event event = maker.event();
  const Event read = decoded(at, event).what;
  require(!maker.exact() || read == event, "an event is read as it was");
  require(!maker.stable() || decoded(at, read).what == read, "what was read once stays as it is");
}

void check_header(Input& input) {
  Maker maker(input);
  const TapeHeader header = maker.header();
  const TapeHeader read = decoded(header);
  require(!maker.exact() || read == header, "a header is read as it was");
  require(!maker.stable() || decoded(read) == read, "what was read once of a header stays as it is");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  switch (input(4)) {
    case 0:
      check_event(input);
      break;
    case 1:
      check_header(input);
      break;
    case 2:
      check_line(input.rest());
      break;
    default:
      check_file(input.rest());
  }
  return 0;
}
