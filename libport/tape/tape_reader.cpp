#include "libport/tape/tape_reader.hpp"

#include <filesystem>
#include <system_error>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/tape/block_file.hpp"
#include "libport/tape/end_check.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/layout.hpp"
#include "libport/tape/merge_order.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

// A stream of the tape whose next item is looked at before it is taken.
template <class File>
class Head {
 public:
  enum class State : std::uint8_t { unknown, item, end, failed };

  void set(File file) { file_.emplace(std::move(file)); }
  [[nodiscard]] bool exists() const { return file_.has_value(); }
  File& file() { return *file_; }
  [[nodiscard]] const File& file() const { return *file_; }

  State look() {
    if (state_ != State::unknown) return state_;
    if (!file_) return state_ = State::end;
    switch (file_->next()) {
      case File::Step::end:
        return state_ = State::end;
      case File::Step::failed:
        return state_ = State::failed;
      default:
        return state_ = State::item;
    }
  }
  // The item stays valid until the next look().
  void take() { state_ = State::unknown; }
  void rewind() {
    state_ = State::unknown;
    if (file_) file_->rewind();
  }
  // Whether it was at its end and is not any more.
  bool read_on() {
    if (!file_ || state_ != State::end) return false;
    state_ = State::unknown;
    file_->read_on();
    return look() != State::end;
  }

 private:
  std::optional<File> file_;
  State state_ = State::unknown;
};

Result<std::unique_ptr<ByteSource>> open_if_there(const std::filesystem::path& path) {
  std::error_code failed;
  if (std::filesystem::status(path, failed).type() == std::filesystem::file_type::not_found) {
    return std::unique_ptr<ByteSource>();
  }
  auto file = FileSource::open(path);
  if (!file) return file.error();
  return std::unique_ptr<ByteSource>(std::move(*file));
}

Record record_of(const BlockPiece& piece, RecordKind kind) {
  Record record;
  record.kind = kind;
  record.at = piece.at;
  record.data = piece.data;
  record.stream_offset = piece.stream_offset;
  record.file_offset = piece.header_offset;
  record.block_length = piece.block_length;
  record.piece_offset = piece.piece_offset;
  return record;
}

RecordKind kind_of(const Event& event) {
  if (std::holds_alternative<event::Open>(event)) return RecordKind::open;
  if (std::holds_alternative<event::Close>(event)) return RecordKind::close;
  if (std::holds_alternative<event::Gap>(event)) return RecordKind::gap;
  const auto* ended = std::get_if<event::HalfClose>(&event);
  if (ended != nullptr && ended->by) return RecordKind::half_close;
  const auto* lost = std::get_if<event::DeviceLost>(&event);
  return lost != nullptr && lost->hung_up ? RecordKind::hang_up : RecordKind::event;
}

Record record_of(const TapeEvent& event, std::string_view line) {
  Record record;
  record.kind = kind_of(event.what);
  record.at = event.at;
  record.event = &event.what;
  record.event_line = line;
  return record;
}

// The files of a tape differ in the last letter.
EndCheck::Names names_of(const TapeSources& sources) {
  const std::string& events = sources.events->name();
  const std::string base = events.substr(0, events.empty() ? 0 : events.size() - 1);
  const auto name = [&](const std::unique_ptr<ByteSource>& source, char letter) {
    return source ? source->name() : base + letter;
  };
  return {name(sources.read, 'r'), name(sources.write, 'w'), events, sources.read != nullptr,
          sources.write != nullptr};
}

void add_note(std::optional<std::string>& notes, const std::optional<std::string>& note) {
  if (!note) return;
  notes = notes ? *notes + "; " + *note : *note;
}

}  // namespace

struct TapeReader::Impl {
  Head<BlockFile> read;
  Head<BlockFile> write;
  Head<EventFile> events;
  bool has_events = false;
  Options options;
  std::optional<Error> events_error;  // of one that may fail
  std::optional<EndCheck> end_check;
  bool came_to_end = false;

  TapeFile look();
  Result<std::optional<Record>> next();
  Result<std::optional<Record>> at_end();
  std::optional<Record> passed(const Record& record);
};

Result<TapeSources> TapeSources::open(const TapePaths& paths) { return open(paths, open_if_there); }

Result<TapeSources> TapeSources::open(const TapePaths& paths, const Open& open_file) {
  auto read = open_file(paths.read);
  if (!read) return read.error();
  auto write = open_file(paths.write);
  if (!write) return write.error();
  if (!*read && !*write) {
    return make_error(Errc::usage, "no tape " + in_quotes(paths.name()) + ": there is neither " +
                                       in_quotes(paths.read.string()) + " nor " +
                                       in_quotes(paths.write.string()));
  }
  auto events = open_file(paths.events);
  if (!events) return events.error();
  return TapeSources{std::move(*read), std::move(*write), std::move(*events)};
}

Result<Layout> TapeSources::layout() const {
  Result<Layout> found = detect_layout(read.get(), write.get());
  if (found || found.error().code != Errc::not_a_tape || !events) return found;
  std::string head(EventFile::kMaxLine, '\0');
  const auto size = events->read_at(0, {reinterpret_cast<Byte*>(head.data()), head.size()});
  if (!size) return found;
  head.resize(*size);
  if (!decode_header(std::string_view(head).substr(0, head.find('\n')))) return found;
  return make_error(Errc::damaged_tape, found.error().message);
}

Result<TapeReader> TapeReader::open(const TapePaths& paths, const Options& options) {
  // Looked at first: a tape that ends meanwhile may have been read before its end.
  const bool checks_end = options.checks_end && !is_being_written(paths);
  auto sources = TapeSources::open(paths);
  if (!sources) return sources.error();
  Options known = options;
  known.checks_end = checks_end;
  return from_sources(std::move(*sources), known);
}

Result<TapeReader> TapeReader::from_sources(TapeSources sources, const Options& options) {
  const Select select = options.select;
  const auto layout = sources.layout();
  if (!layout) return layout.error();
  auto impl = std::make_unique<Impl>();
  impl->has_events = sources.events != nullptr;
  impl->options = options;
  std::optional<EndCheck::Names> checked;
  if (options.checks_end && select == Select::merged && sources.events) checked = names_of(sources);
  if (sources.read && (select == Select::merged || select == Select::reads_only)) {
    impl->read.set(BlockFile(std::move(sources.read), *layout, BlockFile::Blocks::whole));
  }
  if (sources.write && (select == Select::merged || select == Select::writes_only)) {
    impl->write.set(BlockFile(std::move(sources.write), *layout, BlockFile::Blocks::whole));
  }
  if (sources.events && (select == Select::merged || select == Select::events_only)) {
    auto events = EventFile::create(std::move(sources.events));
    if (events) {
      if (checked) impl->end_check.emplace(*checked, events->header());
      impl->events.set(std::move(*events));
    } else if (options.events_may_fail) {
      impl->events_error = events.error();
    } else {
      return events.error();
    }
  }
  return TapeReader(std::move(impl));
}

TapeReader::TapeReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TapeReader::TapeReader(TapeReader&&) noexcept = default;
TapeReader& TapeReader::operator=(TapeReader&&) noexcept = default;
TapeReader::~TapeReader() = default;

Result<std::optional<Record>> TapeReader::next() { return impl_->next(); }

// The file whose item comes next.
TapeFile TapeReader::Impl::look() {
  using BlockState = Head<BlockFile>::State;
  using EventState = Head<EventFile>::State;
  const EventState e = events.look();
  const BlockState w = write.look();
  const BlockState r = read.look();
  const TapeTime next_event = e == EventState::item ? events.file().event().at : kNoMore;
  const TapeTime next_write = w == BlockState::item ? write.file().piece().at : kNoMore;
  const TapeTime next_read = r == BlockState::item ? read.file().piece().at : kNoMore;
  return next_in_order(next_event, next_write, next_read);
}

// A failed stream ends the tape: what comes after its damage in the others has no known place in the order.
Result<std::optional<Record>> TapeReader::Impl::next() {
  TapeFile file = look();
  // A file that was at its end when it was looked at may have got something since that comes before.
  while (options.grows && file != TapeFile::none) {
    const bool more_events = events.read_on();
    const bool more_writes = write.read_on();
    const bool more_reads = read.read_on();
    if (!more_events && !more_writes && !more_reads) break;
    file = look();
  }
  if (events.look() == Head<EventFile>::State::failed) {
    if (!options.events_may_fail) return events.file().error();
    events_error = events.file().error();
  }
  if (write.look() == Head<BlockFile>::State::failed) return write.file().error();
  if (read.look() == Head<BlockFile>::State::failed) return read.file().error();
  switch (file) {
    case TapeFile::none:
      return at_end();
    case TapeFile::events:
      events.take();
      return passed(record_of(events.file().event(), events.file().line()));
    case TapeFile::write:
      write.take();
      return passed(record_of(write.file().piece(), RecordKind::write));
    case TapeFile::read:
      break;
  }
  read.take();
  return passed(record_of(read.file().piece(), RecordKind::read));
}

Result<std::optional<Record>> TapeReader::Impl::at_end() {
  if (events_error) return *events_error;
  came_to_end = true;
  if (!end_check) return std::optional<Record>{};
  const std::optional<Error> flaw = end_check->flaw();
  return flaw ? Result<std::optional<Record>>(*flaw) : std::optional<Record>{};
}

std::optional<Record> TapeReader::Impl::passed(const Record& record) {
  if (end_check) end_check->pass(record);
  return record;
}

Result<void> TapeReader::rewind() {
  impl_->read.rewind();
  impl_->write.rewind();
  impl_->events.rewind();
  if (impl_->end_check) impl_->end_check->rewind();
  impl_->came_to_end = false;
  return {};
}

bool TapeReader::came_to_end() const { return impl_->came_to_end; }

void TapeReader::read_on() {
  (void)impl_->read.read_on();
  (void)impl_->write.read_on();
  (void)impl_->events.read_on();
}

bool TapeReader::has_events() const { return impl_->has_events; }

std::optional<TapeHeader> TapeReader::header() const {
  if (!impl_->events.exists()) return std::nullopt;
  return impl_->events.file().header();
}

std::string TapeReader::header_line() const {
  return impl_->events.exists() ? impl_->events.file().header_line() : std::string();
}

std::optional<std::string> TapeReader::torn_tail() const {
  std::optional<std::string> notes;
  if (impl_->read.exists()) add_note(notes, impl_->read.file().torn_tail());
  if (impl_->write.exists()) add_note(notes, impl_->write.file().torn_tail());
  if (impl_->events.exists()) add_note(notes, impl_->events.file().torn_tail());
  return notes;
}

std::optional<std::string> TapeReader::half() const {
  if (has_events()) return std::nullopt;
  std::optional<std::string> notes = torn_tail();
  if (!impl_->read.exists()) add_note(notes, "it has no r file, and what that held is not known");
  if (!impl_->write.exists()) add_note(notes, "it has no w file, and what that held is not known");
  return notes;
}

}  // namespace porttape
