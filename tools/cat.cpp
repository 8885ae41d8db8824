#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/rules/byte_pattern.hpp"
#include "libport/tape/event_texts.hpp"
#include "libport/tape/tape_group.hpp"
#include "libport/tape/tape_lock.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tools/cat_lines.hpp"
#include "tools/command_line.hpp"
#include "tools/follow.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/output.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kCatHelp{
    "cat", "TAPE... [--full] [--follow] [--json] [--from S] [--to S] [--dir r|w] [--find EXPR] [--blocks]",
    "Prints a tape in order, a line a burst: time in seconds, direction (r: the driver reads,\n"
    "w: it writes), length, the bytes as text and in hex. A burst is blocks of one direction\n"
    "less than 500 us apart with nothing in between. Long ones are cut to the terminal's width\n"
    "($COLUMNS; elsewhere to 32 bytes), which '...' says; --full shows all bytes. Of several\n"
    "tapes, recorded on one machine since its last boot or parts of one tape, each line has its\n"
    "tape's name, and time begins with the earliest. Exit status: 0, 1 a tape is damaged (what\n"
    "is sound is printed) or cannot be read, 2 it is not a tape or not there.\n",
    "  porttape cat laser.log\n"
    "  porttape cat laser.log --follow\n"
    "  porttape cat broker.log broker.c2.log broker.c3.log\n"
    "  porttape cat laser.log --full --from 1.5 --to 2 | less\n"
    "  porttape cat gps.log --dir r --find 'GPGGA|GPRMC' --time wall --as text\n"
    "  porttape cat laser.log --json --dir r | jq -r .hex | xxd -r -p\n"};

constexpr Micros kBurstGap{500};
constexpr Nanos kRotation = std::chrono::milliseconds(300);
constexpr std::size_t kMaxBurst = std::size_t{64} * 1024;

struct CatOptions {
  TapeTime from{};
  TapeTime to = TapeTime::max();
  std::optional<Direction> direction;
  std::optional<BytePattern> wanted;
  bool blocks = false;
  bool follow = false;
};

// Joins blocks to bursts and hands them to the printer, those in which `wanted` is found. A block over
// kMaxBurst goes through as its pieces come; where something is wanted each piece is a line.
class BurstJoiner {
 public:
  BurstJoiner(CatPrinter& printer, bool join, const std::optional<BytePattern>& wanted)
      : printer_(printer), join_(join), wanted_(wanted) {}

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

  void on_event(const Record& record, TapeTime at) {
    flush();
    bool wanted = !wanted_;
    if (wanted_)
      each_text(record.event_line, [&](std::string_view text) { wanted |= wanted_->in(as_bytes(text)); });
    if (wanted) printer_.event(record, at);
  }

  // What comes is of this one of several tapes.
  void of(const std::string& tape) {
    flush();
    printer_.of(tape);
  }

  void flush() {
    if (!line_) return;
    if (is_wanted(data_)) {
      printer_.begin(*line_);
      printer_.data(data_);
      printer_.end();
    }
    line_.reset();
    data_.clear();
  }

 private:
  [[nodiscard]] bool is_wanted(ByteView bytes) const { return !wanted_ || wanted_->in(bytes); }

  void pass_through(const Record& record, Direction direction) {
    flush();
    if (wanted_) {
      line_ = CatLine{direction, record.at, record.at, record.stream_offset, record.data.size(), 1};
      data_.assign(record.data.begin(), record.data.end());
      return flush();
    }
    if (record.piece_offset == 0) {
      printer_.begin({direction, record.at, record.at, record.stream_offset, record.block_length, 1});
    }
    printer_.data(record.data);
    if (record.last_piece()) printer_.end();
  }

  CatPrinter& printer_;
  bool join_;
  const std::optional<BytePattern>& wanted_;
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

// Prints what is there. True: more may come, and is wanted.
Result<bool> print_tape(TapeReader& tape, const CatOptions& options, CatPrinter& printer,
                        const std::ostream& out) {
  BurstJoiner joiner(printer, !options.blocks, options.wanted);
  bool more = true;
  bool ended = false;
  while (more && out.good()) {
    const auto record = tape.next();
    if (!record) {
      joiner.flush();
      return record.error();
    }
    if (!*record) break;
    if ((**record).at >= options.to) {
      more = false;
    } else if (is_wanted(**record, options)) {
      is_block(**record) ? joiner.on_block(**record) : joiner.on_event(**record, (**record).at);
    } else {
      joiner.flush();  // something is in between, though it is not shown
    }
    const Event* const event = (**record).event;
    // What has its time comes behind it.
    if (event != nullptr && std::holds_alternative<event::End>(*event)) ended = true;
  }
  joiner.flush();
  return more && !ended && out.good();
}

int fail(const Error& error, std::ostream& out, std::ostream& err) {
  return fail_verb("cat", error, out, err);
}

void note(const std::string& text, std::ostream& out, std::ostream& err) {
  out.flush();
  err << "porttape cat: note: " << printable_line(text) << '\n';
}

// The recorder makes the next part when it has ended this one.
void note_next_part(const TapePaths& paths, const TapeReader& tape, Nanos limit, std::ostream& out,
                    std::ostream& err) {
  const auto header = tape.header();
  if (!header || header->id.empty()) return;
  const auto next = next_part(paths, header->id.raw(), limit);
  if (next) note("it goes on as " + *next, out, err);
}

// Prints what comes, until the tape ends or nobody writes it or reads us any more.
Result<void> follow_tape(TapeReader& tape, const TapePaths& paths, const CatOptions& options,
                         CatPrinter& printer, std::ostream& out, std::ostream& err) {
  const TapeGrowth growth(paths, descriptor_of(out));
  for (;;) {
    const bool written = is_being_written(paths);  // before it is read: nothing comes after
    const Result<bool> more = print_tape(tape, options, printer, out);
    out.flush();
    if (!more) return more.error();
    if (!*more) {
      // A rotation takes a moment from the end of one tape to the next.
      if (options.to == TapeTime::max())
        note_next_part(paths, tape, written ? kRotation : Nanos::zero(), out, err);
      return {};
    }
    if (!written) {
      note("nobody writes this tape; it has no end", out, err);
      return {};
    }
    if (growth.wait() == TapeGrowth::News::no_reader) return {};
    tape.read_on();
  }
}

// What --as and --time say of the layout; `zero`, where a tape tells it, is that of time.
std::optional<std::string> take_layout(const CommandLine& line, const std::optional<TapeZero>& zero,
                                       TextCatPrinter::Layout& layout) {
  using Form = TextCatPrinter::Form;
  using Times = TextCatPrinter::Times;
  const std::string form = line.text("as").value_or("both");
  const std::string times = line.text("time").value_or("tape");
  if (form != "both" && form != "text" && form != "hex")
    return "--as is '" + form + "'; it must be both, text or hex";
  if (times != "tape" && times != "delta" && times != "wall")
    return "--time is '" + times + "'; it must be tape, delta or wall";
  layout.form = form == "both" ? Form::both : form == "text" ? Form::text : Form::hex;
  layout.times = times == "tape" ? Times::tape : times == "delta" ? Times::delta : Times::wall;
  if (layout.times != Times::wall || line.has("json")) return std::nullopt;
  if (!zero) return "--time wall: the tape does not tell when it was recorded; take tape or delta";
  layout.zero = *zero;
  return std::nullopt;
}

int cat_tape(const std::string& argument, const CatOptions& options, CatPrinter& printer, std::ostream& out,
             std::ostream& err) {
  const auto paths = find_tape(argument);
  if (!paths) {
    Error missing = paths.error();
    if (options.follow)
      missing.message = "a tape begins when a driver first opens the port; " + missing.message;
    return fail(missing, out, err);
  }
  auto tape = TapeReader::open(*paths, {.grows = options.follow, .events_may_fail = true});
  if (!tape) return fail(tape.error(), out, err);
  Result<void> printed;
  if (options.follow) {
    printed = follow_tape(*tape, *paths, options, printer, out, err);
  } else if (const Result<bool> all = print_tape(*tape, options, printer, out); !all) {
    printed = all.error();
  }
  if (!printed) {
    fail(printed.error(), out, err);
    return exit_status::kRuntime;
  }
  if (const auto torn = tape->torn_tail()) note(*torn, out, err);
  return exit_status::kPass;
}

// Several tapes on one time.
class TapeGroup {
 public:
  // Errc::usage: one is given twice, or they do not tell their common time.
  static Result<TapeGroup> open(const std::vector<TapePaths>& paths) {
    Result<std::vector<GroupedTape>> tapes = grouped_tapes(paths);
    if (!tapes) return tapes.error();
    auto begins = begins_by_parts(*tapes);
    if (!begins) begins = begins_by_clock(*tapes);
    if (!begins)
      return make_error(
          Errc::usage,
          "the tapes do not tell their common time: they are of different machines or boots, or "
          "were converted; porttape merge puts them together");
    place_tapes(*tapes, *begins);
    TapeGroup group;
    for (const GroupedTape& tape : *tapes) {
      Result<TapeReader> reader = TapeReader::open(tape.paths, {.events_may_fail = true});
      if (!reader) return reader.error();
      group.inputs_.push_back(std::make_unique<GroupInput>(std::move(*reader), tape.at));
      group.names_.push_back(tape.paths.file_name());
      if (tape.at == Micros{} && tape.header) group.zero_ = tape.header->zero;
    }
    return group;
  }

  [[nodiscard]] const std::optional<TapeZero>& zero() const { return zero_; }
  [[nodiscard]] std::size_t columns() const {
    std::size_t most = 0;
    for (const std::string& name : names_) most = std::max(most, printable_line(name).size());
    return most;
  }

  // Damage of one tape ends that one alone.
  int print(const CatOptions& options, CatPrinter& printer, std::ostream& out, std::ostream& err) {
    BurstJoiner joiner(printer, !options.blocks, options.wanted);
    const auto advance = [&](GroupInput& input) {
      const Result<void> advanced = input.advance();
      if (advanced) return;
      joiner.flush();
      fail(advanced.error(), out, err);
      damaged_ = true;
    };
    for (const auto& input : inputs_) advance(*input);
    const GroupInput* before = nullptr;
    while (out.good()) {
      GroupInput* const next = earliest_of(inputs_);
      if (next == nullptr || next->at() >= options.to) break;
      if (std::exchange(before, next) != next) joiner.of(name_of(*next));
      for (bool whole = false; !whole && !next->over(); advance(*next)) {
        Record record = next->record();
        record.at = next->at();
        whole = !is_block(record) || record.last_piece();
        if (!is_wanted(record, options))
          joiner.flush();
        else
          is_block(record) ? joiner.on_block(record) : joiner.on_event(next->record(), next->at());
      }
    }
    joiner.flush();
    for (const auto& input : inputs_) {
      if (const auto torn = input->reader().torn_tail()) note(name_of(*input) + ": " + *torn, out, err);
    }
    return damaged_ ? exit_status::kRuntime : exit_status::kPass;
  }

 private:
  [[nodiscard]] const std::string& name_of(const GroupInput& input) const {
    const auto at = std::ranges::find(inputs_, &input, &std::unique_ptr<GroupInput>::get);
    return names_.at(static_cast<std::size_t>(at - inputs_.begin()));
  }

  std::vector<std::unique_ptr<GroupInput>> inputs_;
  std::vector<std::string> names_;
  std::optional<TapeZero> zero_;
  bool damaged_ = false;
};

// When that tape's time begins, where it tells.
Result<std::optional<TapeZero>> zero_of(const std::string& tape) {
  const auto paths = find_tape(tape);
  if (!paths) return paths.error();
  const auto reader = TapeReader::open(*paths, {.events_may_fail = true});
  if (!reader) return reader.error();
  const auto header = reader->header();
  return header ? header->zero : std::nullopt;
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
  if (options.to <= options.from)
    return "--to is " + in_quotes(line.text("to").value_or("")) + "; it must be later than --from";
  if (const auto direction = line.text("dir")) {
    if (*direction != "r" && *direction != "w") return "--dir is '" + *direction + "'; it must be r or w";
    options.direction = *direction == "r" ? Direction::read : Direction::write;
  }
  if (const auto expression = line.text("find")) {
    Result<BytePattern> wanted = BytePattern::compile(*expression);
    if (!wanted) return "--find: " + wanted.error().message;
    options.wanted = std::move(*wanted);
  }
  options.blocks = line.has("blocks");
  options.follow = line.has("follow");
  if (line.tapes().size() > 1 && options.follow) return "--follow takes one tape";
  return std::nullopt;
}

}  // namespace

int run_cat(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kCatHelp);
  line.flag("json", "JSON Lines, data whole (tools/OUTPUT.md)")
      .value("from", "S", "from this second on")
      .value("to", "S", "up to this second, which is not included")
      .value("dir", "r|w", "one direction only, and no events")
      .value("find", "EXPR",
             "only lines in whose bytes, and events in whose kind or text, this regular expression is found")
      .value("as", "both|text|hex", "how bytes are shown [default both]")
      .value("time", "tape|delta|wall",
             "since the tape's begin, since the line before, or of the day "
             "[default tape]")
      .flag("blocks", "a line for every block, bursts are not joined")
      .flag("full", "all bytes, in as many rows as they take")
      .flag("follow,f", "goes on with what is being written, up to the tape's end")
      .color();
  if (const auto done = line.parse(args, out, err)) return *done;
  CatOptions options;
  if (const auto wrong = take_options(line, options)) return line.usage_error(err, *wrong);
  TextCatPrinter::Layout layout;
  layout.color = line.colors(out);
  layout.full = line.has("full");
  layout.width = columns_of(out);
  std::optional<TapeGroup> group;
  if (line.tapes().size() > 1) {
    std::vector<TapePaths> paths;
    for (const std::string& tape : line.tapes()) {
      const auto found = find_tape(tape);
      if (!found) return fail(found.error(), out, err);
      paths.push_back(*found);
    }
    Result<TapeGroup> opened = TapeGroup::open(paths);
    if (!opened && opened.error().code == Errc::usage) return line.usage_error(err, opened.error().message);
    if (!opened) return fail(opened.error(), out, err);
    group.emplace(std::move(*opened));
    layout.tape_columns = group->columns();
  }
  std::optional<TapeZero> zero = group ? group->zero() : std::nullopt;
  if (!group && line.text("time") == "wall") {
    const auto told = zero_of(line.tapes().front());
    if (!told) return fail(told.error(), out, err);
    zero = *told;
  }
  if (const auto wrong = take_layout(line, zero, layout)) return line.usage_error(err, *wrong);
  std::unique_ptr<CatPrinter> printer = std::make_unique<TextCatPrinter>(out, layout);
  if (line.has("json")) printer = std::make_unique<JsonCatPrinter>(out);
  if (group) return group->print(options, *printer, out, err);
  return cat_tape(line.tapes().front(), options, *printer, out, err);
}

}  // namespace porttape
