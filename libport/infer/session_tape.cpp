#include "libport/infer/session_tape.hpp"

#include <fmt/format.h>
#include <utility>

namespace porttape {

Result<SessionTape> read_session(RecordSource& source, std::string name, std::size_t most) {
  SessionTape session;
  session.name = std::move(name);
  for (;;) {
    const auto next = source.next();
    if (!next) return next.error();
    if (!*next) return session;
    const Record& record = **next;
    session.gaps = session.gaps || record.kind == RecordKind::gap;
    if (record.kind != RecordKind::read && record.kind != RecordKind::write) continue;
    const bool is_write = record.kind == RecordKind::write;
    Bytes& bytes = is_write ? session.writes : session.reads;
    if (record.data.size() > most - bytes.size())
      return make_error(Errc::usage,
                        fmt::format("{} has more than {} bytes in one direction; rules are inferred from "
                                    "shorter sessions: record one",
                                    session.name, most));
    const Direction direction = is_write ? Direction::write : Direction::read;
    if (record.piece_offset > 0) {
      session.blocks.back().size += record.data.size();
    } else if (!record.data.empty()) {
      session.blocks.push_back({direction, record.at, bytes.size(), record.data.size()});
    }
    bytes.insert(bytes.end(), record.data.begin(), record.data.end());
  }
}

Result<std::optional<Record>> SessionWrites::next() {
  while (block_ < session_.blocks.size() && session_.blocks[block_].direction != Direction::write) ++block_;
  if (block_ == session_.blocks.size()) return std::optional<Record>{};
  const SessionTape::Block& block = session_.blocks[block_++];
  Record record;
  record.kind = RecordKind::write;
  record.at = block.at;
  record.data = session_.bytes_of(block);
  record.stream_offset = block.begin;
  record.block_length = static_cast<std::uint32_t>(block.size);
  return std::optional<Record>{record};
}

Result<void> SessionWrites::rewind() {
  block_ = 0;
  return {};
}

}  // namespace porttape
