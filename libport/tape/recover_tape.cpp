#include "libport/tape/recover_tape.hpp"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"
#include "libport/tape/block_salvage.hpp"
#include "libport/tape/event_salvage.hpp"
#include "libport/tape/layout.hpp"
#include "libport/tape/merge_order.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

// What the events file says of the tape as a whole.
struct ToldOfTape {
  std::string header_line;
  std::optional<TapeHeader> header;
  bool ends = false;
  event::End end;  // where it does
  TapeTime end_at{};
  bool lines_changed = false;  // before that
};

// The layout, also where detect_layout() finds none since the begin is damaged.
Result<Layout> layout_of(ByteSource* read, ByteSource* write) {
  const Result<Layout> detected = detect_layout(read, write);
  if (detected || detected.error().code != Errc::not_a_tape) return detected;
  for (const Layout layout : {Layout::big_endian, Layout::native64}) {
    for (ByteSource* const source : {read, write}) {
      if (source == nullptr) continue;
      const auto size = source->size();
      if (!size) return size.error();
      const auto found = BlockSalvage::holds_blocks(*source, layout, *size);
      if (!found) return found.error();
      if (*found) return layout;
    }
  }
  return make_error(Errc::not_a_tape, detected.error().message + "; no blocks are found in them either");
}

// An r or w file with its next sound block in view.
class SalvageFile {
 public:
  SalvageFile(Direction direction, std::filesystem::path path)
      : direction_(direction), path_(std::move(path)) {}

  Result<void> open(std::unique_ptr<ByteSource> source, Layout layout) {
    if (!source) return {};
    const auto size = source->size();
    if (!size) return size.error();
    salvage_.emplace(std::move(source), layout, *size);
    return advance();
  }
  Result<void> advance() {
    auto step = salvage_->next();
    if (!step) return step.error();
    step_ = std::move(*step);
    return {};
  }

  [[nodiscard]] bool exists() const { return salvage_.has_value(); }
  [[nodiscard]] Direction direction() const { return direction_; }
  [[nodiscard]] TapeTime at() const { return step_.block ? step_.block->at : kNoMore; }
  [[nodiscard]] const SalvagedBlock& block() const { return *step_.block; }
  // In front of the block in view, or at the end.
  std::optional<LostBytes> take_lost() { return std::exchange(step_.lost, std::nullopt); }
  [[nodiscard]] std::string name() const { return path_.filename().string(); }
  BlockSalvage& salvage() { return *salvage_; }

  PayloadCounter kept;

 private:
  Direction direction_;
  std::filesystem::path path_;
  std::optional<BlockSalvage> salvage_;
  BlockSalvage::Step step_;
};

// The same of an events file.
class SalvageEvents {
 public:
  Result<void> open(ByteSource* source) {
    if (source == nullptr) return {};
    const auto size = source->size();
    if (!size) return size.error();
    salvage_.emplace(*source, *size);
    return advance();
  }
  Result<void> advance() {
    auto step = salvage_->next();
    if (!step) return step.error();
    step_ = std::move(*step);
    return {};
  }

  [[nodiscard]] TapeTime at() const { return step_.line ? step_.line->event.at : kNoMore; }
  [[nodiscard]] const EventSalvage::Line& line() const { return *step_.line; }
  [[nodiscard]] const std::string& header_line() const { return salvage_->header_line(); }
  std::optional<LostLines> take_lost() { return std::exchange(step_.lost, std::nullopt); }

 private:
  std::optional<EventSalvage> salvage_;
  EventSalvage::Step step_;
};

class TapeRecoverer {
 public:
  TapeRecoverer(const TapePaths& from, const TapePaths& to, const RecoverOptions& options)
      : from_(from),
        options_(options),
        read_(Direction::read, from.read),
        write_(Direction::write, from.write) {
    done_.paths = to;
  }

  Result<RecoveredTape> run() {
    if (Result<void> opened = open(); !opened) return opened.error();
    if (Result<void> begun = begin(); !begun) return begun.error();
    for (bool over = false; !over;) {
      const TapeFile file = next_in_order(events_.at(), write_.at(), read_.at());
      over = file == TapeFile::none;
      const Result<void> taken = file == TapeFile::none     ? take_end()
                                 : file == TapeFile::events ? take_event()
                                 : file == TapeFile::write  ? take_block(write_)
                                                            : take_block(read_);
      if (!taken) return taken.error();
    }
    const Result<TapePaths> paths = finish();
    if (!paths) return paths.error();
    done_.paths = *paths;
    return std::move(done_);
  }

 private:
  // An end that vouches only for what the source's did.
  Result<TapePaths> finish() {
    if (events_source_ && !told_.ends) return tape_->finish(std::nullopt);
    if (!events_source_ && (!read_.exists() || !write_.exists())) return tape_->finish(std::nullopt);
    const auto vouches = told_.end.events ? NewTape::Vouches::all : NewTape::Vouches::data;
    if (told_.end.read && told_.end.write) return tape_->finish(told_.end_at, vouches);
    const TapeTime behind = std::min(tape_->latest() + Micros(1), tape_time_us(kMaxBlockTimeUs));
    const TapeTime at = std::max(told_.end_at, behind);
    if (const auto ended = tape_->event(at, event::End{}); !ended) return ended.error();
    return tape_->finish(std::nullopt);
  }

  Result<void> open() {
    if (is_being_written(from_))
      return make_error(Errc::usage, in_quotes(from_.name()) + " is being written; end its recorder first");
    Result<TapeSources> sources = TapeSources::open(from_);
    if (!sources) return sources.error();
    events_source_ = std::move(sources->events);
    const Result<Layout> layout = layout_of(sources->read.get(), sources->write.get());
    if (!layout) return layout.error();
    if (Result<void> told = read_told(); !told) return told;
    if (Result<void> opened = read_.open(std::move(sources->read), *layout); !opened) return opened;
    if (Result<void> opened = write_.open(std::move(sources->write), *layout); !opened) return opened;
    return events_.open(events_source_.get());
  }

  // Goes over the events once: the end tells what the other files held.
  Result<void> read_told() {
    if (!events_source_) {
      done_.notes.push_back(from_.events.filename().string() +
                            " is not there: nothing is known of opens and settings");
      for (const auto& path : {from_.read, from_.write}) {
        std::error_code unknown;
        if (!std::filesystem::exists(path, unknown))
          done_.notes.push_back(path.filename().string() + " is not there: what it held is not known");
      }
      return {};
    }
    SalvageEvents events;
    if (Result<void> opened = events.open(events_source_.get()); !opened) return opened;
    for (; events.at() != kNoMore;) {
      const TapeEvent& event = events.line().event;
      const auto* end = std::get_if<event::End>(&event.what);
      told_.ends = end != nullptr;
      told_.end = told_.ends ? *end : event::End{};
      told_.end_at = event.at;
      told_.lines_changed = events.line().others_changed;
      if (Result<void> advanced = events.advance(); !advanced) return advanced;
    }
    told_.header_line = events.header_line();
    if (const auto header = decode_header(told_.header_line)) told_.header = *header;
    return {};
  }

  Result<void> begin() {
    TapeHeader header = made_of(told_.header, from_.file_name(), "recover");
    if (told_.header) header.previous = told_.header->previous;
    if (events_source_ && !told_.header) header.stamped.reset();
    Result<NewTape> tape =
        NewTape::create(done_.paths, made_line(told_.header_line, header), options_.writer);
    if (!tape) return tape.error();
    tape_.emplace(std::move(*tape));
    return {};
  }

  Result<void> take_event() {
    if (Result<void> told = tell(events_.take_lost(), events_.at()); !told) return told;
    const EventSalvage::Line& line = events_.line();
    progress(line.text.size() + 1);
    last_event_ = line.event.at;
    if (!std::holds_alternative<event::End>(line.event.what)) {
      ++done_.events;
      if (Result<void> put = tape_->event_line(line.event.at, line.text); !put) return put;
    }
    return events_.advance();
  }

  Result<void> take_block(SalvageFile& file) {
    if (Result<void> told = tell(file, file.take_lost(), file.at()); !told) return told;
    const SalvagedBlock& block = file.block();
    ++done_.blocks;
    file.kept.begin_block(block.at, block.length);
    if (Result<void> begun = tape_->begin_block(file.direction(), block.at, block.length); !begun)
      return begun;
    for (std::uint64_t offset = block.data_offset; offset < block.end();) {
      const auto data = file.salvage().data(offset, block.end() - offset);
      if (!data) return data.error();
      if (data->empty()) return make_error(Errc::io, file.name() + " became shorter while it was read");
      file.kept.add(*data);
      if (Result<void> added = tape_->add(*data); !added) return added;
      offset += data->size();
      progress(data->size());
    }
    progress(kHeaderSize);
    return file.advance();
  }

  // Tells what each file lost after its last sound block or event, and which of the files never was there.
  Result<void> take_end() {
    const TapeTime last = tape_->latest();
    for (SalvageFile* const file : {&read_, &write_}) {
      if (Result<void> told = tell(*file, file->take_lost(), last); !told) return told;
    }
    if (Result<void> told = tell(events_.take_lost(), last); !told) return told;
    const bool damaged = !done_.clean();
    for (SalvageFile* const file : {&read_, &write_}) {
      const bool of_read = file->direction() == Direction::read;
      const auto& totals = of_read ? told_.end.read : told_.end.write;
      if (Result<void> compared = compare(*file, totals ? &*totals : nullptr, damaged); !compared)
        return compared;
    }
    if (!told_.lines_changed || !done_.clean()) return {};
    return lose(
        from_.events.filename().string() +
            ": a line is not as it was written, by the digest that the end tells; which one is not known",
        0, TapeTime{}, tape_->latest());
  }

  // With what the end tells of it.
  Result<void> compare(SalvageFile& file, const PayloadTotals* told, bool damaged) {
    const PayloadTotals kept = file.kept.totals();
    const bool missing = !file.exists();
    if (missing && (told == nullptr || told->blocks == 0)) {
      done_.notes.push_back(file.name() + " is not there" + (told != nullptr ? "; it held nothing" : ""));
      return {};
    }
    if (told == nullptr) return {};
    const bool other_bytes = told->xxh3 && kept.xxh3 != told->xxh3;
    const bool other_blocks = told->xxh3_all && kept.xxh3_all != told->xxh3_all;
    const bool differs =
        kept.blocks != told->blocks || kept.bytes != told->bytes || other_bytes || other_blocks;
    if (!differs || (damaged && !missing)) return {};
    const std::string is = "of " + std::to_string(told->blocks) + " blocks and " +
                           std::to_string(told->bytes) + " bytes, as the end tells, " +
                           std::to_string(kept.blocks) + " and " + std::to_string(kept.bytes) + " are there";
    const std::string why = missing ? file.name() + " is missing: " + is
                            : kept.blocks == told->blocks && kept.bytes == told->bytes
                                ? file.name() + ": the " +
                                      (other_bytes ? "bytes" : "times or lengths of the blocks") +
                                      " are not those that the end tells of"
                                : file.name() + ": " + is;
    return lose(why, told->bytes > kept.bytes ? told->bytes - kept.bytes : 0, TapeTime{}, tape_->latest());
  }

  Result<void> tell(SalvageFile& file, const std::optional<LostBytes>& lost, TapeTime at) {
    if (!lost) return {};
    progress(lost->bytes);
    const std::string where = file.name() + " at offset " + std::to_string(lost->offset) + ": ";
    if (lost->bytes == 0) return lose(where + lost->why, 0, lost->from, at);
    // At most: there was a header too.
    const std::uint64_t bytes = lost->bytes > kHeaderSize ? lost->bytes - kHeaderSize : lost->bytes;
    return lose(where + std::to_string(lost->bytes) + " bytes of the file are lost: " + lost->why, bytes,
                lost->from, at);
  }

  Result<void> tell(const std::optional<LostLines>& lost, TapeTime at) {
    if (!lost) return {};
    const std::string lines = lost->lines == 1 ? "line " + std::to_string(lost->line)
                                               : std::to_string(lost->lines) + " lines from line " +
                                                     std::to_string(lost->line) + " on";
    return lose(from_.events.filename().string() + ": " + lines + " lost: " + lost->why, 0, last_event_, at);
  }

  Result<void> lose(std::string what, std::uint64_t bytes, TapeTime from, TapeTime at) {
    constexpr std::size_t most = 64;
    ++done_.loss_count;
    Result<void> put = tape_->event(at, event::Gap{bytes, std::min(from, at), what});
    if (done_.losses.size() < most) done_.losses.push_back(std::move(what));
    return put;
  }

  void progress(std::uint64_t bytes) {
    bytes_ += bytes;
    if (options_.progress) options_.progress(bytes_);
  }

  TapePaths from_;
  const RecoverOptions& options_;
  RecoveredTape done_;
  ToldOfTape told_;
  std::unique_ptr<ByteSource> events_source_;
  SalvageFile read_;
  SalvageFile write_;
  SalvageEvents events_;
  std::optional<NewTape> tape_;
  TapeTime last_event_{};
  std::uint64_t bytes_ = 0;
};

}  // namespace

Result<RecoveredTape> recover_tape(const TapePaths& from, const TapePaths& to,
                                   const RecoverOptions& options) {
  return TapeRecoverer(from, to, options).run();
}

}  // namespace porttape
