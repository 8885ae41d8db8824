#include "libport/tape/tape_writer.hpp"

#include <algorithm>
#include <exception>
#include <utility>

#include "libport/tape/block.hpp"
#include "libport/tape/event.hpp"
#include "libport/tape/payload_totals.hpp"
#include "libport/tape/tape_files.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMaxBlock = std::size_t{64} * 1024;

}  // namespace

struct TapeWriter::Impl {
  // What could not be written and is not told in a gap event yet.
  struct Gap {
    std::uint64_t bytes = 0;
    std::int64_t from_us = 0;
    std::string why;

    // The line that tells it, if the tape goes on at `at_us`.
    [[nodiscard]] std::string line(std::int64_t at_us) const {
      return encode(tape_time_us(at_us), event::Gap{bytes, tape_time_us(from_us), why});
    }
  };

  explicit Impl(TapeSinks sinks)
      : read(std::move(sinks.read)), write(std::move(sinks.write)), events(std::move(sinks.events)) {}
  ~Impl() {
    try {
      finish(tape_time_us(last_us), {});
    } catch (const std::exception&) {  // no memory: it has no end then
    }
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  int begin(TapeHeader header, const TapeWriterOptions& options);
  [[nodiscard]] std::int64_t stamp(TapeTime at, bool is_block) const;
  void block(Direction direction, TapeTime at, ByteView data);
  void keep(Direction direction, std::int64_t us, ByteView payload);
  bool commit(const RunBoth& run_both, std::optional<TapeTime> end = {});
  [[nodiscard]] TapeBatch::Line last_line(std::int64_t us, const std::vector<TapeBatch::Line>& before) const;
  int put_line(const std::string& line);
  void settle(Direction direction, const TapeBatch::Blocks& blocks);
  std::optional<Gap> tell_owed(TapeBatch& batch, std::optional<std::int64_t> first_kept);
  void write_lines(const std::vector<TapeBatch::Line>& lines, std::optional<Gap> told);
  WholeAppender& file_of(Direction direction) { return direction == Direction::read ? read : write; }
  void event(std::int64_t at_us, const std::string& line);
  void put_event(std::int64_t at_us, const std::string& line);
  void put_end(TapeTime at);
  void lose(std::int64_t at_us, std::uint64_t bytes, std::string why);
  void tell_gap(std::int64_t at_us);
  void finish(TapeTime at, const RunBoth& run_both);
  void close_all(const RunBoth& run_both);

  WholeAppender read;
  WholeAppender write;
  WholeAppender events;
  std::optional<TapeBatch> batch;
  PayloadCounter kept_read;
  PayloadCounter kept_write;
  StreamDigest kept_lines;
  TapePaths paths;
  std::string id;
  bool sync = false;
  bool finished = false;

  std::int64_t last_us = -1;  // stamp of the last thing written
  bool last_was_block =
      false;  // after a block the next stamp must be later, after an event it may be the same
  std::optional<Gap> gap;
  std::string failure;     // why the last thing could not be written
  std::string first_loss;  // why the first thing was lost
  std::uint64_t bytes_lost = 0;
  std::uint64_t events_lost = 0;
  std::uint64_t bytes_written = 0;
  int sync_error = 0;
};

// Writes the header line. 0, or the errno: the files are to be closed then.
int TapeWriter::Impl::begin(TapeHeader header, const TapeWriterOptions& options) {
  header = completed(std::move(header));
  id = header.id.raw();
  if (const int error = put_line(encode(header)); error != 0) {
    finished = true;
    return error;
  }
  sync = options.sync;
  return 0;
}

// Whole, or not at all. 0, or the errno.
int TapeWriter::Impl::put_line(const std::string& line) {
  const int error = events.append({}, as_bytes(line));
  if (error == 0) kept_lines.add(as_bytes(line));
  return error;
}

std::int64_t TapeWriter::Impl::stamp(TapeTime at, bool is_block) const {
  const std::int64_t earliest = last_us + (last_was_block || last_us < 0 ? 1 : 0);
  const std::int64_t us = std::max(to_us(at), earliest);
  return is_block ? us : std::min(us, kMaxBlockTimeUs);
}

void TapeWriter::Impl::block(Direction direction, TapeTime at, ByteView data) {
  const std::int64_t us = stamp(at, true);
  if (finished || us > kMaxBlockTimeUs) {
    return lose(us, data.size(),
                finished ? "the tape is finished" : "a tape cannot hold more than 136 years");
  }
  const auto header = encode_header(tape_time_us(us), static_cast<std::uint32_t>(data.size()));
  if (batch) {
    batch->of(direction).add(us, header, data);
    last_us = us;
    last_was_block = true;
    return;
  }
  if (const int error = file_of(direction).append(header, data); error != 0)
    return lose(us, data.size(), errno_text(error));
  last_us = us;
  last_was_block = true;
  keep(direction, us, data);
  failure.clear();
  tell_gap(us);  // at the same stamp, where events come first: the gap ends with this block
}

// A block that stands on the tape.
void TapeWriter::Impl::keep(Direction direction, std::int64_t us, ByteView payload) {
  PayloadCounter& counter = direction == Direction::read ? kept_read : kept_write;
  counter.begin_block(tape_time_us(us), static_cast<std::uint32_t>(payload.size()));
  counter.add(payload);
  bytes_written += payload.size();
}

void TapeWriter::Impl::event(std::int64_t at_us, const std::string& line) {
  if (finished) return;
  if (batch) {
    batch->lines.push_back({at_us, line});
    last_us = at_us;
    last_was_block = false;
    return;
  }
  tell_gap(at_us);
  put_event(at_us, line);
}

void TapeWriter::Impl::put_event(std::int64_t at_us, const std::string& line) {
  if (const int error = put_line(line); error != 0) {
    ++events_lost;
    return lose(at_us, 0, errno_text(error));
  }
  last_us = at_us;
  last_was_block = false;
  failure.clear();
}

// With `end`, the tape's last line goes along if nothing speaks against it: true then.
bool TapeWriter::Impl::commit(const RunBoth& run_both, std::optional<TapeTime> end) {
  if (!batch) return false;
  TapeBatch done = std::move(*batch);
  batch.reset();
  const auto write_read = [&] { done.read.write(read); };
  const auto write_write = [&] { done.write.write(write); };
  if (run_both && !done.read.blocks.empty() && !done.write.blocks.empty()) {
    run_both(write_read, write_write);
  } else {
    write_read();
    write_write();
  }
  std::optional<std::int64_t> first_kept;
  for (const TapeBatch::Blocks* blocks : {&done.read, &done.write}) {
    if (blocks->kept.parts == 0) continue;
    const std::int64_t us = blocks->blocks.front().us;
    first_kept = std::min(us, first_kept.value_or(us));
  }
  const std::optional<Gap> told = tell_owed(done, first_kept);
  failure.clear();
  settle(Direction::read, done.read);
  settle(Direction::write, done.write);
  const bool ends = end && !gap;  // a new gap is told first
  if (ends) done.lines.push_back(last_line(stamp(*end, false), done.lines));
  write_lines(done.lines, told);
  return ends;
}

// The `end`, if it comes behind `before`.
TapeBatch::Line TapeWriter::Impl::last_line(std::int64_t us,
                                            const std::vector<TapeBatch::Line>& before) const {
  StreamDigest lines = kept_lines;
  for (const TapeBatch::Line& line : before) lines.add(as_bytes(line.text));
  return {us, encode(tape_time_us(us), event::End{kept_read.totals(), kept_write.totals(), lines.value()})};
}

// A gap from before the batch ends with the first thing of it that is written. Puts its line in its place.
std::optional<TapeWriter::Impl::Gap> TapeWriter::Impl::tell_owed(TapeBatch& done,
                                                                 std::optional<std::int64_t> first_kept) {
  if (!gap || (!first_kept && done.lines.empty())) return std::nullopt;
  std::int64_t us = first_kept.value_or(done.lines.empty() ? 0 : done.lines.front().us);
  if (!done.lines.empty()) us = std::min(us, done.lines.front().us);
  done.lines.insert(done.lines.begin(), {us, gap->line(us)});
  return std::exchange(gap, std::nullopt);
}

void TapeWriter::Impl::settle(Direction direction, const TapeBatch::Blocks& blocks) {
  for (std::size_t i = 0; i < blocks.blocks.size(); ++i) {
    const ByteView payload = blocks.payload(i);
    i < blocks.kept.parts ? keep(direction, blocks.blocks[i].us, payload)
                          : lose(blocks.blocks[i].us, payload.size(), errno_text(blocks.kept.error));
  }
}

// `told`: the gap whose line is the first of them.
void TapeWriter::Impl::write_lines(const std::vector<TapeBatch::Line>& lines, std::optional<Gap> told) {
  std::string text;
  std::vector<std::size_t> ends;
  for (const TapeBatch::Line& line : lines) {
    text += line.text;
    ends.push_back(text.size());
  }
  if (text.empty()) return;
  const auto [written, error] = events.append_parts(as_bytes(text), ends);
  if (written > 0) kept_lines.add(as_bytes(text).first(ends[written - 1]));
  for (std::size_t i = written; i < lines.size(); ++i) {
    const bool is_gap = i == 0 && told;
    if (!is_gap) ++events_lost;
    lose(is_gap ? told->from_us : lines[i].us, is_gap ? told->bytes : 0,
         is_gap ? told->why : errno_text(error));
    if (is_gap) bytes_lost -= told->bytes;  // counted already
  }
}

void TapeWriter::Impl::lose(std::int64_t at_us, std::uint64_t bytes, std::string why) {
  bytes_lost += bytes;
  failure = std::move(why);
  if (first_loss.empty()) first_loss = failure;
  if (finished) return;
  if (!gap) gap = Gap{0, std::min(at_us, kMaxBlockTimeUs), failure};
  gap->bytes += bytes;
}

// Says what is missing, if anything; stays owed where even that cannot be written.
void TapeWriter::Impl::tell_gap(std::int64_t at_us) {
  if (!gap) return;
  if (put_line(gap->line(at_us)) == 0) gap.reset();
}

void TapeWriter::Impl::finish(TapeTime at, const RunBoth& run_both) {
  if (finished) return;
  if (!commit(run_both, at)) put_end(at);
  finished = true;
  close_all(run_both);
}

// A tape that lacks what no gap tells has no end.
void TapeWriter::Impl::put_end(TapeTime at) {
  const std::int64_t us = std::max(stamp(at, false), gap ? gap->from_us : 0);
  tell_gap(us);
  if (!gap) put_event(us, last_line(us, {}).text);
}

void TapeWriter::Impl::close_all(const RunBoth& run_both) {
  const std::array<WholeAppender*, 3> files = {&read, &write, &events};
  std::array<int, 3> errors{};
  const auto bring_to_disk = [&](std::size_t i) {
    errors.at(i) = files.at(i)->repair();
    const int synced = sync ? files.at(i)->sink().syncer()() : 0;
    if (errors.at(i) == 0) errors.at(i) = synced;
  };
  if (run_both) {
    run_both([&] { bring_to_disk(0); },
             [&] { run_both([&] { bring_to_disk(1); }, [&] { bring_to_disk(2); }); });
  } else {
    for (std::size_t i = 0; i < files.size(); ++i) bring_to_disk(i);
  }
  for (std::size_t i = 0; i < files.size(); ++i) {
    const int closed = files.at(i)->sink().close();
    for (const int error : {errors.at(i), closed}) {
      if (sync_error == 0) sync_error = error;
    }
  }
}

Result<void> TapeWriter::check(const TapePaths& paths, const TapeWriterOptions& options) {
  return check_tape_files(paths, options.on_existing);
}

Result<TapeWriter> TapeWriter::create(const TapePaths& paths, const TapeHeader& header,
                                      const TapeWriterOptions& options) {
  auto files = NewTapeFiles::make(paths, options);
  if (!files) return files.error();
  auto impl = std::make_unique<Impl>(std::move(files->sinks));
  impl->paths = files->paths;
  if (const int error = impl->begin(header, options); error != 0) {
    files->discard();
    impl->close_all({});
    return make_error(Errc::io, "cannot write " + files->paths.events.string() + ": " + errno_text(error));
  }
  if (const auto published = files->publish(); !published) {
    files->discard();
    return published.error();
  }
  return TapeWriter(std::move(impl));
}

Result<TapeWriter> TapeWriter::on_sinks(TapeSinks sinks, const TapeHeader& header,
                                        const TapeWriterOptions& options) {
  auto impl = std::make_unique<Impl>(std::move(sinks));
  if (const int error = impl->begin(header, options); error != 0) {
    impl->close_all({});
    return make_error(Errc::io, errno_text(error));
  }
  return TapeWriter(std::move(impl));
}

TapeWriter::TapeWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TapeWriter::TapeWriter(TapeWriter&&) noexcept = default;
TapeWriter& TapeWriter::operator=(TapeWriter&&) noexcept = default;
TapeWriter::~TapeWriter() = default;

void TapeWriter::read_block(TapeTime at, ByteView data) {
  for (; !data.empty(); data = data.subspan(std::min(kMaxBlock, data.size()))) {
    impl_->block(Direction::read, at, data.first(std::min(kMaxBlock, data.size())));
  }
}

void TapeWriter::write_block(TapeTime at, ByteView data) {
  for (; !data.empty(); data = data.subspan(std::min(kMaxBlock, data.size()))) {
    impl_->block(Direction::write, at, data.first(std::min(kMaxBlock, data.size())));
  }
}

void TapeWriter::event(TapeTime at, Event event) {
  const std::int64_t us = impl_->stamp(at, false);
  auto* gap = std::get_if<event::Gap>(&event);
  if (gap != nullptr && !gap->from) gap->from = tape_time_us(us);
  impl_->event(us, encode(tape_time_us(us), event));
}

void TapeWriter::event_line(TapeTime at, std::string_view line) {
  const std::int64_t us = impl_->stamp(at, false);
  impl_->event(us, encode_again(line, tape_time_us(us)));
}

void TapeWriter::begin_batch() {
  if (!impl_->batch) impl_->batch.emplace();
}
void TapeWriter::commit(const RunBoth& run_both) { (void)impl_->commit(run_both); }

void TapeWriter::lose(TapeTime at, std::uint64_t bytes, std::string_view why) {
  const bool in_batch = impl_->batch.has_value();
  (void)impl_->commit({});  // the gap comes behind what was given before it
  impl_->lose(impl_->stamp(at, false), bytes, std::string(why));
  if (in_batch) begin_batch();
}

std::array<TapeSink::Sync, 3> TapeWriter::syncers() {
  return {impl_->read.sink().syncer(), impl_->write.sink().syncer(), impl_->events.sink().syncer()};
}

Result<void> TapeWriter::finish(TapeTime at, const RunBoth& run_both) {
  impl_->finish(at, run_both);
  if (impl_->bytes_lost > 0 || impl_->events_lost > 0 || impl_->gap) {
    return make_error(Errc::io, std::to_string(impl_->bytes_lost) + " bytes and " +
                                    std::to_string(impl_->events_lost) +
                                    " events are missing from the tape: " + impl_->first_loss);
  }
  if (impl_->sync_error != 0) {
    return make_error(Errc::io, "the tape may be incomplete: " + errno_text(impl_->sync_error));
  }
  return {};
}

const TapePaths& TapeWriter::paths() const { return impl_->paths; }
const std::string& TapeWriter::id() const { return impl_->id; }
bool TapeWriter::failing() const { return !impl_->failure.empty(); }
std::string TapeWriter::failure() const { return impl_->failure; }
std::uint64_t TapeWriter::bytes_lost() const { return impl_->bytes_lost; }
std::uint64_t TapeWriter::bytes_written() const { return impl_->bytes_written; }

}  // namespace porttape
