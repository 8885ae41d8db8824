#include "libport/taped/played_tape.hpp"

#include <utility>

namespace porttape {

PlayedTape::PlayedTape(TapeReader reader, const PlayedAs& as, Select select)
    : reader_(std::move(reader)), played_(&reader_) {
  if (!as.part.whole()) played_ = &part_.emplace(*played_, as.part);
  if (as.writer == Writer::driver) return;
  played_ = &swapped_.emplace(
      *played_, select == Select::merged ? SwappedTape::Select::merged : SwappedTape::Select::writes_only);
}

Result<std::unique_ptr<PlayedTape>> PlayedTape::open(const TapePaths& paths, const PlayedAs& as,
                                                     Select select) {
  const bool writes_alone = select == Select::compared && as.writer == Writer::driver;
  const auto of_tape = writes_alone ? TapeReader::Select::writes_only : TapeReader::Select::merged;
  // tape_facts() has looked at its files.
  Result<TapeReader> reader = TapeReader::open(paths, {.select = of_tape, .checks_end = false});
  if (!reader) return reader.error();
  return std::unique_ptr<PlayedTape>(new PlayedTape(std::move(*reader), as, select));
}

}  // namespace porttape
