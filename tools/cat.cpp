#include <charconv>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "libport/base/printable.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tools/cat_lines.hpp"
#include "tools/command_line.hpp"
#include "tools/output.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kHelp{
    "cat", "TAPE [--json] [--from S] [--to S] [--dir r|w] [--blocks]",
    "Prints a tape in order, a line a burst: time in seconds, direction (r: the driver reads,\n"
    "w: it writes), length, the bytes as text and in hex. A burst is blocks of one direction\n"
    "less than 500 us apart with nothing in between. Exit status: 0, 1 the tape is damaged (all\n"
    "before the damage is printed) or cannot be read, 2 it is not a tape or not there.\n",
    "  porttape cat laser.log\n"
    "  porttape cat laser.log --from 1.5 --to 2 --blocks\n"
    "  porttape cat laser.log --json --dir r | jq -r .hex | xxd -r -p\n"};

constexpr Micros kBurstGap{500};
constexpr std::size_t kMaxBurst = std::size_t{64} * 1024;

struct CatOptions {
  TapeTime from{};
  TapeTime to = TapeTime::max();
  std::optional<Direction> direction;
  bool blocks = false;
};

// Seconds with up to 6 decimals that count.
std::optional<TapeTime> parse_seconds(std::string_view text) {
  double seconds = 0;
  const auto [end, error] =
      std::from_chars(text.data(), text.data() + text.size(), seconds, std::chars_format::fixed);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  if (!(seconds >= 0) || seconds > 1e10) return std::nullopt;
  return tape_time_us(std::llround(seconds * 1e6));
}

// Joins blocks to bursts and hands them to the printer. A block over kMaxBurst goes through as its pieces
// come.
class BurstJoiner {
 public:
  BurstJoiner(CatPrinter& printer, bool join) : printer_(printer), join_(join) {}

  void on_block(const Record& record) {
    const Direction direction = record.kind == RecordKind::read ? Direction::read : Direction::write;
    if (record.block_length > kMaxBurst) return pass_through(record, direction);
    const bool joins = join_ && line_ && line_->direction == direction &&
                       record.at - line_->until < kBurstGap && data_.size() + record.data.size() <= kMaxBurst;
    if (!joins) {
      flush();
      line_ = CatLine{direction, record.at, record.at, record.stream_offset, 0, 0};
    }
    data_.insert(data_.end(), record.data.begin(), record.data.end());
    line_->until = record.at;
    line_->length = data_.size();
    ++line_->blocks;
  }

  void on_event(const Record& record) {
    flush();
    printer_.event(record);
  }

  void flush() {
    if (!line_) return;
    printer_.begin(*line_);
    printer_.data(data_);
    printer_.end();
    line_.reset();
    data_.clear();
  }

 private:
  void pass_through(const Record& record, Direction direction) {
    flush();
    if (record.piece_offset == 0) {
      printer_.begin({direction, record.at, record.at, record.stream_offset, record.block_length, 1});
    }
    printer_.data(record.data);
    if (record.last_piece()) printer_.end();
  }

  CatPrinter& printer_;
  bool join_;
  std::optional<CatLine> line_;
  Bytes data_;
};

bool is_block(const Record& record) {
  return record.kind == RecordKind::read || record.kind == RecordKind::write;
}

bool is_wanted(const Record& record, const CatOptions& options) {
  if (record.at < options.from) return false;
  if (!options.direction) return true;
  return record.kind == (*options.direction == Direction::read ? RecordKind::read : RecordKind::write);
}

// Prints until the tape ends, --to is reached, or `out` fails.
Result<void> print_tape(TapeReader& tape, const CatOptions& options, CatPrinter& printer,
                        const std::ostream& out) {
  BurstJoiner joiner(printer, !options.blocks);
  while (out.good()) {
    const auto record = tape.next();
    if (!record) {
      joiner.flush();
      return record.error();
    }
    if (!*record || (**record).at >= options.to) break;
    if (is_wanted(**record, options)) {
      is_block(**record) ? joiner.on_block(**record) : joiner.on_event(**record);
    } else {
      joiner.flush();  // something is in between, though it is not shown
    }
  }
  joiner.flush();
  return {};
}

int fail(const Error& error, std::ostream& out, std::ostream& err) {
  out.flush();
  err << "porttape cat: " << printable_line(error.message) << '\n';
  return exit_status_of(error.code);
}

int cat_tape(const std::string& argument, const CatOptions& options, CatPrinter& printer, std::ostream& out,
             std::ostream& err) {
  const auto paths = find_tape(argument);
  if (!paths) return fail(paths.error(), out, err);
  auto tape = TapeReader::open(*paths);
  if (!tape) return fail(tape.error(), out, err);
  if (const auto printed = print_tape(*tape, options, printer, out); !printed) {
    return fail(printed.error(), out, err);
  }
  if (const auto note = tape->torn_tail()) {
    out.flush();
    err << "porttape cat: note: " << printable_line(*note) << '\n';
  }
  return exit_status::kPass;
}

// Gives what is wrong, or nothing.
std::optional<std::string> take_options(const CommandLine& line, CatOptions& options) {
  for (const auto& [name, time] : {std::pair{"from", &options.from}, std::pair{"to", &options.to}}) {
    const auto text = line.text(name);
    if (!text) continue;
    const auto seconds = parse_seconds(*text);
    if (!seconds) return "--" + std::string(name) + " is '" + *text + "'; it must be seconds, e.g. 1.5";
    *time = *seconds;
  }
  if (const auto direction = line.text("dir")) {
    if (*direction != "r" && *direction != "w") return "--dir is '" + *direction + "'; it must be r or w";
    options.direction = *direction == "r" ? Direction::read : Direction::write;
  }
  options.blocks = line.has("blocks");
  if (line.tapes().size() > 1) return "more than one tape given";
  return std::nullopt;
}

}  // namespace

int run_cat(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kHelp);
  line.flag("json", "JSON Lines, data whole (tools/OUTPUT.md)")
      .value("from", "S", "from this second on")
      .value("to", "S", "up to this second, which is not included")
      .value("dir", "r|w", "one direction only, and no events")
      .flag("blocks", "a line for every block, bursts are not joined");
  if (const auto done = line.parse(args, out, err)) return *done;
  CatOptions options;
  if (const auto wrong = take_options(line, options)) return line.usage_error(err, *wrong);
  std::unique_ptr<CatPrinter> printer = std::make_unique<TextCatPrinter>(out, wants_color(out));
  if (line.has("json")) printer = std::make_unique<JsonCatPrinter>(out);
  return cat_tape(line.tapes().front(), options, *printer, out, err);
}

}  // namespace porttape
