#include "libport/tape/tape_reader.hpp"

#include <filesystem>
#include <system_error>
#include <utility>

#include "libport/tape/block_file.hpp"
#include "libport/tape/events.hpp"
#include "libport/tape/layout.hpp"

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

Record record_of(const TapeEvent& event) {
  Record record;
  record.kind = event.kind == "open"                           ? RecordKind::open
                : event.kind == "close"                        ? RecordKind::close
                : event.kind == "device-lost" && event.hung_up ? RecordKind::hang_up
                : event.kind == "gap"                          ? RecordKind::gap
                                                               : RecordKind::event;
  record.at = event.at;
  record.event = event.kind;
  record.event_line = event.line;
  if (record.kind != RecordKind::gap) return record;
  record.gap_bytes = event.bytes;
  record.gap_from = event.from;
  record.gap_why = event.why;
  return record;
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

  Result<std::optional<Record>> next();
};

Result<TapeSources> TapeSources::open(const TapePaths& paths) {
  TapeSources sources;
  auto read = open_if_there(paths.read);
  if (!read) return read.error();
  auto write = open_if_there(paths.write);
  if (!write) return write.error();
  if (!*read && !*write) {
    return make_error(Errc::usage, "no tape '" + paths.name() + "': there is neither " + paths.read.string() +
                                       " nor " + paths.write.string());
  }
  auto events = open_if_there(paths.events);
  if (!events) return events.error();
  return TapeSources{std::move(*read), std::move(*write), std::move(*events)};
}

Result<TapeReader> TapeReader::open(const TapePaths& paths, Select select) {
  auto sources = TapeSources::open(paths);
  if (!sources) return sources.error();
  return from_sources(std::move(*sources), select);
}

Result<TapeReader> TapeReader::from_sources(TapeSources sources, Select select) {
  const auto layout = detect_layout(sources.read.get(), sources.write.get());
  if (!layout) return layout.error();
  auto impl = std::make_unique<Impl>();
  impl->has_events = sources.events != nullptr;
  if (sources.read && (select == Select::merged || select == Select::reads_only)) {
    impl->read.set(BlockFile(std::move(sources.read), *layout, BlockFile::Blocks::whole));
  }
  if (sources.write && (select == Select::merged || select == Select::writes_only)) {
    impl->write.set(BlockFile(std::move(sources.write), *layout, BlockFile::Blocks::whole));
  }
  if (sources.events && (select == Select::merged || select == Select::events_only)) {
    auto events = EventFile::create(std::move(sources.events));
    if (!events) return events.error();
    impl->events.set(std::move(*events));
  }
  return TapeReader(std::move(impl));
}

TapeReader::TapeReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TapeReader::TapeReader(TapeReader&&) noexcept = default;
TapeReader& TapeReader::operator=(TapeReader&&) noexcept = default;
TapeReader::~TapeReader() = default;

Result<std::optional<Record>> TapeReader::next() { return impl_->next(); }

// A failed stream ends the tape: what comes after its damage in the others has no known place in the order.
Result<std::optional<Record>> TapeReader::Impl::next() {
  using BlockState = Head<BlockFile>::State;
  using EventState = Head<EventFile>::State;
  const EventState e = events.look();
  const BlockState w = write.look();
  const BlockState r = read.look();
  if (e == EventState::failed) return events.file().error();
  if (w == BlockState::failed) return write.file().error();
  if (r == BlockState::failed) return read.file().error();

  const bool has_write = w == BlockState::item;
  const bool has_read = r == BlockState::item;
  if (e == EventState::item) {
    const TapeTime at = events.file().event().at;
    if ((!has_write || at <= write.file().piece().at) && (!has_read || at <= read.file().piece().at)) {
      events.take();
      return std::optional(record_of(events.file().event()));
    }
  }
  if (has_write && (!has_read || write.file().piece().at <= read.file().piece().at)) {
    write.take();
    return std::optional(record_of(write.file().piece(), RecordKind::write));
  }
  if (!has_read) return std::optional<Record>{};
  read.take();
  return std::optional(record_of(read.file().piece(), RecordKind::read));
}

Result<void> TapeReader::rewind() {
  impl_->read.rewind();
  impl_->write.rewind();
  impl_->events.rewind();
  return {};
}

bool TapeReader::has_events() const { return impl_->has_events; }

std::optional<TapeHeader> TapeReader::header() const {
  if (!impl_->events.exists()) return std::nullopt;
  return impl_->events.file().header();
}

std::optional<std::string> TapeReader::torn_tail() const {
  std::optional<std::string> notes;
  if (impl_->read.exists()) add_note(notes, impl_->read.file().torn_tail());
  if (impl_->write.exists()) add_note(notes, impl_->write.file().torn_tail());
  if (impl_->events.exists()) add_note(notes, impl_->events.file().torn_tail());
  return notes;
}

}  // namespace porttape
