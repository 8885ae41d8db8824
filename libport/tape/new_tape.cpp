#include "libport/tape/new_tape.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <variant>

#include "libport/base/printable.hpp"
#include "libport/tape/block.hpp"
#include "libport/tape/payload_totals.hpp"
#include "libport/tape/tape_files.hpp"

namespace porttape {
namespace {

constexpr std::size_t kWriteAtOnce = std::size_t{256} * 1024;

// Collects what goes to one file.
class BufferedFile {
 public:
  explicit BufferedFile(std::unique_ptr<TapeSink> sink) : sink_(std::move(sink)) {}

  // 0 or the errno.
  int put(ByteView data) {
    if (buffer_.size() + data.size() > kWriteAtOnce) {
      if (const int error = flush(); error != 0) return error;
    }
    if (data.size() >= kWriteAtOnce) return sink_->append({}, data).error;
    buffer_.insert(buffer_.end(), data.begin(), data.end());
    return 0;
  }
  int flush() {
    const int error = buffer_.empty() ? 0 : sink_->append({}, buffer_).error;
    buffer_.clear();
    return error;
  }
  TapeSink& sink() { return *sink_; }

 private:
  std::unique_ptr<TapeSink> sink_;
  Bytes buffer_;
};

std::string seconds_text(std::int64_t us) {
  const std::string digits = std::to_string(us % 1'000'000);
  return std::to_string(us / 1'000'000) + "." + std::string(6 - digits.size(), '0') + digits + " s";
}

}  // namespace

struct NewTape::Impl {
  struct File {
    BufferedFile file;
    PayloadCounter payload;
    std::int64_t last_us = 0;
  };

  Impl(TapeSinks sinks, TapePaths to)
      : read{BufferedFile(std::move(sinks.read)), PayloadCounter()},
        write{BufferedFile(std::move(sinks.write)), PayloadCounter()},
        events{BufferedFile(std::move(sinks.events)), PayloadCounter(false)},
        paths(std::move(to)) {}

  Result<void> failed(Error error) {
    if (!failure) failure = std::move(error);
    return *failure;
  }
  Result<void> put(File& file, ByteView data) {
    const int error = file.file.put(data);
    if (error == 0) return {};
    return failed(make_error(Errc::io, "cannot write " + name_of(file) + ": " + errno_text(error)));
  }
  Result<void> put_line(std::string_view text) {
    lines.add(as_bytes(text));
    return put(events, as_bytes(text));
  }
  Result<void> take_time(File& file, TapeTime at);
  Result<void> line(TapeTime at, const std::string& text);
  [[nodiscard]] std::string name_of(const File& file) const;
  Result<void> bring_to_disk();

  File read;
  File write;
  File events;
  StreamDigest lines;
  TapePaths paths;
  std::optional<NewTapeFiles> files;  // none: other sinks
  std::optional<Error> failure;
  File* open_block = nullptr;
  std::uint64_t missing = 0;  // of the block that is open
  bool sync = true;
};

std::string NewTape::Impl::name_of(const File& file) const {
  const auto& path = &file == &read ? paths.read : &file == &write ? paths.write : paths.events;
  return path.empty() ? "the tape" : in_quotes(path.string());
}

Result<void> NewTape::Impl::take_time(File& file, TapeTime at) {
  if (failure) return *failure;
  const std::int64_t us = to_us(at);
  if (missing > 0) {
    return failed(make_error(Errc::usage, "a block lacks " + std::to_string(missing) + " of its bytes"));
  }
  if (us < 0 || us > kMaxBlockTimeUs)
    return failed(make_error(Errc::usage, "a tape has no room for the time " + std::to_string(us) + " us"));
  if (us < file.last_us) {
    return failed(make_error(Errc::usage, "the time goes back, from " + seconds_text(file.last_us) + " to " +
                                              seconds_text(us) + ", which a tape cannot hold"));
  }
  file.last_us = us;
  return {};
}

Result<void> NewTape::Impl::line(TapeTime at, const std::string& text) {
  if (Result<void> taken = take_time(events, at); !taken) return taken;
  return put_line(text);
}

Result<void> NewTape::Impl::bring_to_disk() {
  for (File* const file : {&read, &write, &events}) {
    int error = file->file.flush();
    if (error == 0 && sync) error = file->file.sink().syncer()();
    // It has no name yet.
    if (error != 0 && error != ENOENT)
      return failed(make_error(Errc::io, "cannot write " + name_of(*file) + ": " + errno_text(error)));
  }
  return {};
}

Result<NewTape> NewTape::create(const TapePaths& paths, std::string_view header_line,
                                const TapeWriterOptions& options) {
  if (const auto header = decode_header(header_line); !header) return header.error();
  auto files = NewTapeFiles::make(paths, options, NewTapeFiles::Appear::when_published);
  if (!files) return files.error();
  auto impl = std::make_unique<Impl>(std::move(files->sinks), files->paths);
  impl->files.emplace(std::move(*files));
  impl->sync = options.sync;
  if (const auto put = impl->put_line(std::string(header_line) + "\n"); !put) return put.error();
  return NewTape(std::move(impl));
}

Result<NewTape> NewTape::create(const TapePaths& paths, const TapeHeader& header,
                                const TapeWriterOptions& options) {
  const std::string line = encode(completed(header));
  return create(paths, std::string_view(line).substr(0, line.size() - 1), options);
}

Result<NewTape> NewTape::on_sinks(TapeSinks sinks, const TapeHeader& header) {
  auto impl = std::make_unique<Impl>(std::move(sinks), TapePaths());
  if (const auto put = impl->put_line(encode(completed(header))); !put) return put.error();
  return NewTape(std::move(impl));
}

NewTape::NewTape(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
NewTape::NewTape(NewTape&&) noexcept = default;
NewTape& NewTape::operator=(NewTape&&) noexcept = default;
NewTape::~NewTape() = default;

Result<void> NewTape::block(Direction direction, TapeTime at, ByteView data) {
  const auto length = static_cast<std::uint32_t>(data.size());
  if (length != data.size())
    return impl_->failed(make_error(Errc::usage, "a block of " + std::to_string(data.size()) + " bytes"));
  if (Result<void> begun = begin_block(direction, at, length); !begun) return begun;
  return data.empty() ? Result<void>() : add(data);
}

Result<void> NewTape::begin_block(Direction direction, TapeTime at, std::uint32_t length) {
  Impl::File& file = direction == Direction::read ? impl_->read : impl_->write;
  if (Result<void> taken = impl_->take_time(file, at); !taken) return taken;
  file.payload.begin_block(at, length);
  impl_->open_block = &file;
  impl_->missing = length;
  return impl_->put(file, encode_header(at, length));
}

Result<void> NewTape::add(ByteView piece) {
  if (impl_->failure) return *impl_->failure;
  if (piece.size() > impl_->missing)
    return impl_->failed(make_error(Errc::usage, "a block has more bytes than it was begun with"));
  if (piece.empty()) return {};
  impl_->missing -= piece.size();
  impl_->open_block->payload.add(piece);
  return impl_->put(*impl_->open_block, piece);
}

Result<void> NewTape::event(TapeTime at, const Event& event) { return impl_->line(at, encode(at, event)); }

Result<void> NewTape::event_line(TapeTime at, std::string_view line) {
  return impl_->line(at, encode_again(line, at));
}

Result<void> NewTape::carried_line(TapeTime at, std::string_view line) {
  return impl_->line(at, encode_carried(line, at));
}

Result<void> NewTape::copy(const Record& record, Micros later) {
  const TapeTime at = record.at + later;
  if (record.kind != RecordKind::read && record.kind != RecordKind::write) {
    if (std::holds_alternative<event::End>(*record.event)) return {};
    return event_line(at, record.event_line);
  }
  if (record.piece_offset == 0) {
    const Direction direction = record.kind == RecordKind::read ? Direction::read : Direction::write;
    if (Result<void> begun = begin_block(direction, at, record.block_length); !begun) return begun;
  }
  return add(record.data);
}

Result<TapePaths> NewTape::finish(std::optional<TapeTime> end, Vouches vouches) {
  if (end) {
    // Behind the last block: of equal times events are read first.
    const std::int64_t last_block = std::max(impl_->read.last_us, impl_->write.last_us);
    const std::int64_t earliest = std::max(impl_->events.last_us, std::min(last_block + 1, kMaxBlockTimeUs));
    const TapeTime at = std::max(*end, tape_time_us(earliest));
    event::End totals{impl_->read.payload.totals(), impl_->write.payload.totals(), impl_->lines.value()};
    if (vouches == Vouches::data)
      totals.read->xxh3_all = totals.write->xxh3_all = totals.events = std::nullopt;
    if (const auto ended = impl_->line(at, encode(at, totals)); !ended) return ended.error();
  } else if (const auto taken = impl_->take_time(impl_->events, tape_time_us(impl_->events.last_us));
             !taken) {
    return taken.error();
  }
  if (const auto there = impl_->bring_to_disk(); !there) return there.error();
  if (impl_->files) {
    if (const auto published = impl_->files->publish(); !published) {
      (void)impl_->failed(published.error());
      return published.error();
    }
  }
  const TapePaths paths = impl_->paths;
  (void)impl_->failed(make_error(Errc::usage, "the tape is finished"));
  return paths;
}

TapeTime NewTape::latest() const {
  return tape_time_us(std::max({impl_->read.last_us, impl_->write.last_us, impl_->events.last_us}));
}

}  // namespace porttape
