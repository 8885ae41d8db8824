#include "libport/taped/redact_tape.hpp"

#include <algorithm>
#include <deque>
#include <limits>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"
#include "libport/tape/end_check.hpp"
#include "libport/tape/event_texts.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

using Where = TapeRedaction::Where;

// Blocks that wait for what is behind them; a tape of nothing but empty ones has more.
constexpr std::size_t kMostWaiting = std::size_t{1} << 20;

// Blocks of one direction, whose bytes are redacted and given on.
class BlockRedactor {
 public:
  using Told = std::function<void(const TapeRedaction&)>;

  // `tape` may be null.
  BlockRedactor(const RedactBook& book, Direction direction, NewTape* tape, Told told)
      : direction_(direction),
        stream_(book, direction == Direction::read ? RedactStream::Of::reads : RedactStream::Of::writes),
        tape_(tape),
        told_(std::move(told)),
        idle_(book.frames().idle()) {}

  Result<void> pass(const Record& record) {
    const RecordKind mine = direction_ == Direction::read ? RecordKind::read : RecordKind::write;
    const bool frames_pause = idle_ != Micros::max();
    if (record.kind != mine) {
      if (frames_pause && !record.data.empty()) return stream_.pause();
      return {};
    }
    if (record.piece_offset == 0) {
      if (frames_pause && record.at - last_ >= idle_) {
        if (Result<void> done = stream_.pause(); !done) return done;
      }
      if (waiting_.size() >= kMostWaiting)
        return make_error(Errc::usage, "it has more than a million blocks without a byte in a row");
      waiting_.push_back({record.at, record.stream_offset, record.block_length});
      last_ = record.at;
    }
    if (Result<void> added = stream_.add(record.data); !added) return added;
    return give_on();
  }

  Result<void> finish() {
    if (Result<void> done = stream_.finish(); !done) return done;
    return give_on();
  }
  [[nodiscard]] std::uint64_t wrong_checksums() const { return stream_.wrong_checksums(); }

 private:
  struct Waiting {
    TapeTime at{};
    std::uint64_t offset = 0;
    std::uint32_t length = 0;
  };

  void tell(const Redaction& redaction) {
    const auto behind =
        std::upper_bound(waiting_.begin(), waiting_.end(), redaction.offset,
                         [](std::uint64_t offset, const Waiting& block) { return offset < block.offset; });
    const TapeTime at = behind == waiting_.begin() ? last_ : std::prev(behind)->at;
    told_({direction_ == Direction::read ? Where::read : Where::write,
           at,
           redaction.offset,
           redaction.length,
           redaction.rule,
           {}});
  }

  Result<void> give_on() {
    const RedactStream::Ready ready = stream_.take();
    for (const Redaction& redaction : ready.redactions) tell(redaction);
    ByteView bytes = ready.bytes;
    while (!waiting_.empty()) {
      const Waiting& block = waiting_.front();
      if (block.length > 0 && bytes.empty()) break;
      if (given_ == 0 && tape_ != nullptr) {
        if (Result<void> begun = tape_->begin_block(direction_, block.at, block.length); !begun) return begun;
      }
      const ByteView part = bytes.first(std::min<std::size_t>(bytes.size(), block.length - given_));
      if (tape_ != nullptr) {
        if (Result<void> added = tape_->add(part); !added) return added;
      }
      given_ += static_cast<std::uint32_t>(part.size());
      bytes = bytes.subspan(part.size());
      if (given_ < block.length) break;
      given_ = 0;
      waiting_.pop_front();
    }
    return {};
  }

  Direction direction_;
  RedactStream stream_;
  NewTape* tape_;
  Told told_;
  Micros idle_;
  TapeTime last_{};
  std::deque<Waiting> waiting_;  // the first one may be begun
  std::uint32_t given_ = 0;      // bytes of that
};

class TapeRedactor {
 public:
  TapeRedactor(const TapePaths& from, const TapePaths& to, const RedactOptions& options)
      : from_(from), to_(to), options_(options), book_(options.rules, options.key) {
    done_.paths = to;
    done_.rules.resize(options.rules.redactions.size());
  }

  Result<RedactedTape> run() {
    const bool being_written = is_being_written(from_);  // looked at first, since it may end meanwhile
    Result<TapeReader> reader = TapeReader::open(from_);
    if (!reader) return reader.error();
    if (!being_written) check_.emplace(EndCheck::Names::of(from_), reader->header());
    if (Result<void> begun = begin(*reader); !begun) return begun.error();
    const bool has_events = reader->has_events();
    done_.torn_tail = reader->half();  // a missing file; a torn tail shows later
    for (const Direction direction : {Direction::read, Direction::write}) {
      if (Result<void> passed = blocks(direction); !passed) return passed.error();
    }
    if (Result<void> passed = events(); !passed) return passed.error();
    if (const auto flaw = check_ ? check_->flaw() : std::nullopt) return *flaw;
    if (!tape_) return std::move(done_);
    const bool ends = end_.has_value() || (!has_events && !done_.torn_tail);
    Result<TapePaths> paths =
        tape_->finish(ends ? std::max(end_, std::optional(tape_->latest())) : std::nullopt);
    if (!paths) return paths.error();
    done_.paths = *paths;
    return std::move(done_);
  }

 private:
  Result<void> begin(const TapeReader& reader) {
    const std::optional<TapeHeader> header = reader.header();
    // Of an identity that is refused as well.
    (void)change_texts(reader.header_line(), [this](std::string_view key, std::string_view text) {
      if (key == "identity.serial") serial_ = text;
      return std::string(text);
    });
    std::string line = made_line(reader.header_line(), made_of(header, from_.file_name(), "redact"));
    if (options_.identity) line = hidden(line, Where::header);
    Result<std::string> changed = redacted(line, Where::header, {});
    if (!changed) return changed.error();
    if (options_.dry_run) return {};
    Result<NewTape> tape = NewTape::create(to_, *changed, options_.writer);
    if (!tape) return tape.error();
    tape_.emplace(std::move(*tape));
    return {};
  }

  // Without what tells of machine and device. The device's serial number stands in names of its port, too.
  std::string hidden(const std::string& line, Where where) {
    std::string less = without_identity(line);
    if (serial_.size() >= 4) {
      less = change_texts(less, [&](std::string_view, std::string_view text) {
        std::string out(text);
        for (std::size_t at = out.find(serial_); at != std::string::npos; at = out.find(serial_, at + 1))
          out.replace(at, serial_.size(), serial_.size(), 'x');
        return out;
      });
    }
    if (where == Where::header) done_.identity_gone = less != line;
    return less;
  }

  struct RedactedText {
    std::string text;
    std::vector<Redaction> redactions;
  };
  Result<RedactedText> redacted_text(std::string_view text) const {
    RedactStream stream(book_, RedactStream::Of::text);
    Result<void> done = stream.add(as_bytes(text));
    if (done) done = stream.finish();
    if (!done) return done.error();
    RedactStream::Ready ready = stream.take();
    return RedactedText{std::string(as_text(ready.bytes)), std::move(ready.redactions)};
  }
  // A key may say what is to be hidden, too.
  [[nodiscard]] std::string hidden_key(std::string_view key) const {
    const Result<RedactedText> hidden = redacted_text(key);
    return hidden ? hidden->text : std::string();
  }

  Result<std::string> redacted(std::string_view line, Where where, TapeTime at) {
    std::optional<Error> failed;
    const auto change = [&](std::string_view key, std::string_view text) {
      Result<RedactedText> changed = redacted_text(text);
      if (!changed) failed = changed.error();
      if (!changed) return std::string();
      for (const Redaction& each : changed->redactions)
        tell({where, at, each.offset, each.length, each.rule, hidden_key(key)});
      return std::move(changed->text);
    };
    const auto look = [&](FixedText what, std::string_view key, std::string_view text) {
      const Result<RedactedText> changed = redacted_text(text);
      if (!changed) failed = changed.error();
      if (!changed || changed->redactions.empty()) return;
      const std::string above = key.empty() ? "" : hidden_key(key) + ".";
      const std::string name = what == FixedText::number ? hidden_key(key)
                               : what == FixedText::key  ? above + changed->text
                                                         : changed->text;
      for (const Redaction& each : changed->redactions) note_left({where, at, 1, what, name, each.rule});
    };
    std::string changed = change_texts(line, change, look);
    if (failed) return *failed;
    return changed;
  }

  void note_left(UnredactedText left) {
    constexpr std::size_t most = 64;
    const auto same = std::ranges::find_if(done_.left, [&](const UnredactedText& each) {
      return each.where == left.where && each.what == left.what && each.key == left.key &&
             each.rule == left.rule;
    });
    if (same != done_.left.end()) {
      ++same->count;
    } else if (done_.left.size() < most) {
      done_.left.push_back(std::move(left));
    }
  }

  Result<void> blocks(Direction direction) {
    using Select = TapeReader::Select;
    const bool pauses = book_.frames().idle() != Micros::max();
    const Select mine = direction == Direction::read ? Select::reads_only : Select::writes_only;
    Result<TapeReader> reader =
        TapeReader::open(from_, {.select = pauses ? Select::merged : mine, .checks_end = false});
    if (!reader) return reader.error();
    BlockRedactor redactor(book_, direction, tape_ ? &*tape_ : nullptr,
                           [this](const TapeRedaction& each) { tell(each); });
    for (;;) {
      const Result<std::optional<Record>> next = reader->next();
      if (!next) return next.error();
      if (!*next) break;
      const bool counts =
          (*next)->kind == (direction == Direction::read ? RecordKind::read : RecordKind::write);
      if (check_ && counts) check_->pass(**next);
      if (options_.progress && counts) options_.progress(bytes_ += bytes_in_file(**next));
      if (Result<void> passed = redactor.pass(**next); !passed) return passed;
    }
    if (reader->torn_tail() && !done_.torn_tail) done_.torn_tail = reader->torn_tail();
    if (Result<void> finished = redactor.finish(); !finished) return finished;
    done_.wrong_checksums += redactor.wrong_checksums();
    return {};
  }

  Result<void> events() {
    Result<TapeReader> reader = TapeReader::open(from_, TapeReader::Select::events_only);
    if (!reader) return reader.error();
    for (;;) {
      const Result<std::optional<Record>> next = reader->next();
      if (!next) return next.error();
      if (!*next) return {};
      const Record& record = **next;
      if (options_.progress) options_.progress(bytes_ += bytes_in_file(record));
      if (record.event == nullptr) continue;
      if (check_) check_->pass(record);
      // Without another event behind it: the tape's end.
      end_.reset();
      if (std::holds_alternative<event::End>(*record.event)) {
        end_ = record.at;
        continue;
      }
      std::string line(record.event_line);
      if (options_.identity) line = hidden(line, Where::event);
      Result<std::string> changed = redacted(line, Where::event, record.at);
      if (!changed) return changed.error();
      if (!tape_) continue;
      if (Result<void> put = tape_->event_line(record.at, *changed); !put) return put;
    }
  }

  void tell(const TapeRedaction& redaction) {
    RedactedTape::Use& use =
        redaction.rule < 0 ? done_.follows : done_.rules[static_cast<std::size_t>(redaction.rule)];
    if (use.count++ == 0) use.first = redaction;
    use.bytes += redaction.length;
    if (options_.on_redaction) options_.on_redaction(redaction);
  }

  const TapePaths& from_;
  const TapePaths& to_;
  const RedactOptions& options_;
  RedactBook book_;
  std::optional<NewTape> tape_;    // none: a dry run
  std::optional<EndCheck> check_;  // none: it is being written
  std::string serial_;             // of the device
  RedactedTape done_;
  std::optional<TapeTime> end_;
  std::uint64_t bytes_ = 0;
};

}  // namespace

Result<RedactedTape> redact_tape(const TapePaths& from, const TapePaths& to, const RedactOptions& options) {
  return TapeRedactor(from, to, options).run();
}

}  // namespace porttape
