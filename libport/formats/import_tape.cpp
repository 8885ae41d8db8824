#include "libport/formats/import_tape.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <span>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kProblemsKept = 64;
constexpr std::size_t kLinesTold = 5;
constexpr std::string_view kTooEarly = "what is too early has the time of what came before";
constexpr std::int64_t kBitsOfAByte = 10;  // 8N1
// Later than a tape can tell, and early enough to be added to.
constexpr TapeTime kBeyondAll = tape_time_us(std::int64_t{1} << 60U);

// Of equal times an event comes first, then a write, then a read.
int place_among_equal(RecordKind kind) {
  if (kind == RecordKind::read) return 2;
  return kind == RecordKind::write ? 1 : 0;
}

RecordKind kind_of(Direction direction) {
  return direction == Direction::read ? RecordKind::read : RecordKind::write;
}

// "line 7", "lines 3 and 7", "lines 3, 8, 9, 12, 15 and 20 more".
std::string lines_told(std::span<const std::uint64_t> first, std::uint64_t count) {
  if (count == 1) return fmt::format("line {}", first.front());
  if (count > first.size())
    return fmt::format("lines {} and {} more", fmt::join(first, ", "), count - first.size());
  return fmt::format("lines {} and {}", fmt::join(first.first(first.size() - 1), ", "), first.back());
}

}  // namespace

ImportTape::ImportTape(TapePaths to, TapeWriterOptions writer, ImportOptions options, std::string source)
    : to_(std::move(to)),
      writer_(std::move(writer)),
      options_(std::move(options)),
      source_(std::move(source)) {}

ImportTape::ImportTape(TapeSinks to, ImportOptions options, std::string source)
    : sinks_(std::move(to)), options_(std::move(options)), source_(std::move(source)) {}

Result<void> ImportTape::checked(Result<void> result) {
  if (!result) failed_ = result.error();
  return result;
}

Result<void> ImportTape::header(const TapeHeader& header) {
  header_ = header;
  return {};
}

Result<void> ImportTape::header_line(std::string_view line) {
  const auto decoded = decode_header(line);
  if (!decoded) return decoded.error();
  header_ = *decoded;
  header_line_ = line;
  return {};
}

Result<void> ImportTape::begin() {
  if (failed_) return *failed_;
  if (tape_) return {};
  TapeHeader header = header_.value_or(TapeHeader{});
  if (!header_) {
    header.origin = TapeOrigin{"convert", {{{}, source_}}, std::nullopt};
    if (!wall_of_zero_.empty()) header.zero = TapeZero{wall_of_zero_, 0, ""};
  }
  Result<NewTape> tape = sinks_                 ? NewTape::on_sinks(std::move(*sinks_), header)
                         : header_line_.empty() ? NewTape::create(to_, header, writer_)
                                                : NewTape::create(to_, header_line_, writer_);
  if (!tape) return checked(tape.error());
  tape_.emplace(std::move(*tape));
  return {};
}

TapeTime ImportTape::placed(TapeTime at, RecordKind kind) {
  if (at < latest_told_ && line_ > 0) problem_of_line(line_, "the time goes back; " + std::string(kTooEarly));
  if (at < latest_told_ && line_ == 0 && went_back_++ == 0) first_back_ = at;
  latest_told_ = std::max(latest_told_, at);
  at = std::max(at, latest_);
  if (keeps_order_ && at == latest_ && place_among_equal(kind) < place_among_equal(last_kind_))
    at += Micros(1);
  last_kind_ = kind;
  latest_ = std::min(at, kBeyondAll);
  return latest_ + options_.lead;
}

Result<void> ImportTape::block(Direction direction, std::optional<TapeTime> at, ByteView data) {
  if (Result<void> begun = begin(); !begun) return begun;
  if (!at && options_.bytes_at) {
    at = latest_ + Micros(static_cast<std::int64_t>(data.size()) * kBitsOfAByte * 1'000'000 /
                          static_cast<std::int64_t>(*options_.bytes_at));
  } else if (!at) {
    at = empty() ? latest_ : latest_ + Micros(1);
  }
  ++done_.blocks;
  const Direction way = this->way(direction);
  return checked(tape_->block(way, placed(*at, kind_of(way)), data));
}

Direction ImportTape::way(Direction told) const {
  if (!options_.swapped) return told;
  return told == Direction::read ? Direction::write : Direction::read;
}

Result<void> ImportTape::begin_block(Direction direction, TapeTime at, std::uint32_t length) {
  if (Result<void> begun = begin(); !begun) return begun;
  ++done_.blocks;
  const Direction way = this->way(direction);
  return checked(tape_->begin_block(way, placed(at, kind_of(way)), length));
}

Result<void> ImportTape::add(ByteView piece) {
  if (Result<void> begun = begin(); !begun) return begun;
  return checked(tape_->add(piece));
}

Result<void> ImportTape::event(TapeTime at, const Event& event) {
  if (Result<void> begun = begin(); !begun) return begun;
  ++done_.events;
  return checked(tape_->event(placed(at, RecordKind::event), event));
}

Result<void> ImportTape::event_line(TapeTime at, std::string_view line) {
  if (Result<void> begun = begin(); !begun) return begun;
  ++done_.events;
  return checked(tape_->event_line(placed(at, RecordKind::event), line));
}

void ImportTape::guessed(std::string text) {
  if (std::ranges::find(done_.guesses, text) == done_.guesses.end()) done_.guesses.push_back(std::move(text));
}

void ImportTape::problem(std::string text) {
  ++done_.problem_count;
  if (done_.problems.size() < kProblemsKept) done_.problems.push_back(std::move(text));
}

void ImportTape::problem_of_line(std::uint64_t line, std::string_view text) {
  auto of = std::ranges::find(of_lines_, text, &ProblemOfLines::text);
  if (of == of_lines_.end()) of = of_lines_.insert(of, {std::string(text), {}, 0, 0});
  if (std::exchange(of->last_line, line) == line) return;
  ++of->count;
  if (of->first_lines.size() < kLinesTold) of->first_lines.push_back(line);
}

Result<ImportedTape> ImportTape::finish(std::optional<TapeTime> end) {
  if (Result<void> begun = begin(); !begun) return begun.error();
  if (went_back_ > 0)
    problem(fmt::format("{} times go back, first at {} µs; {}", std::exchange(went_back_, 0),
                        to_us(first_back_), kTooEarly));
  for (const ProblemOfLines& of : std::exchange(of_lines_, {}))
    problem(fmt::format("{}: {}", lines_told(of.first_lines, of.count), of.text));
  keeps_order_ = false;  // these marks are not of the evidence
  for (const std::string& guess : done_.guesses) {
    if (Result<void> told = event(latest_, event::Mark{"convert: " + guess}); !told) return told.error();
  }
  if (end) end = std::clamp(*end, latest_, kBeyondAll) + options_.lead;
  Result<TapePaths> paths = tape_->finish(end);
  if (!paths) return paths.error();
  done_.paths = *paths;
  done_.end = latest_ + options_.lead;
  return done_;
}

}  // namespace porttape
