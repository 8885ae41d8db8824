#include "libport/taped/tape_answers.hpp"

#include "libport/tape/layout.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {

Result<std::unique_ptr<TapeAnswers>> TapeAnswers::open(const TapePaths& tape, const TapePart& part) {
  Result<TapeSources> sources = TapeSources::open(tape);
  if (!sources) return sources.error();
  const Result<Layout> layout = detect_layout(sources->read.get(), sources->write.get());
  if (!layout) return layout.error();
  std::optional<BlockFile> file;
  if (sources->read) file.emplace(std::move(sources->read), *layout, BlockFile::Blocks::whole);
  return std::unique_ptr<TapeAnswers>(new TapeAnswers(std::move(file), part));
}

Result<void> TapeAnswers::seek(std::uint64_t file_offset, std::uint64_t reads) {
  if (file_) file_->seek(file_offset, reads);
  return {};
}

Result<std::optional<Record>> TapeAnswers::next() {
  if (!file_) return std::optional<Record>{};
  switch (file_->next()) {
    case BlockFile::Step::end:
      return std::optional<Record>{};
    case BlockFile::Step::failed:
      return file_->error();
    case BlockFile::Step::piece:
      break;
  }
  const BlockPiece& piece = file_->piece();
  Record record;
  record.kind = RecordKind::read;
  record.at = part_.shifted(piece.at);
  record.data = piece.data;
  record.stream_offset = piece.stream_offset;
  record.file_offset = piece.header_offset;
  record.block_length = piece.block_length;
  record.piece_offset = piece.piece_offset;
  return std::optional(record);
}

}  // namespace porttape
