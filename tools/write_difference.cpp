#include "tools/write_difference.hpp"

#include <algorithm>
#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {
namespace {

using Exchanges = std::vector<WrittenExchange>;

// A table of so many cells is made at most; what is larger is compared in order.
constexpr std::size_t kMostCells = 16'000'000;

// Pairs of equal writes, ascending in both: the longest such list.
class Alignment {
 public:
  Alignment(const Exchanges& one, const Exchanges& other)
      : one_(one), other_(other), columns_(other.size() + 1), lengths_((one.size() + 1) * columns_) {
    for (std::size_t i = one.size(); i-- > 0;) {
      for (std::size_t k = other.size(); k-- > 0;)
        at(i, k) = same(i, k) ? at(i + 1, k + 1) + 1 : std::max(at(i + 1, k), at(i, k + 1));
    }
  }
  [[nodiscard]] bool same(std::size_t i, std::size_t k) const { return one_[i].write == other_[k].write; }
  // At two that differ: whether the first tape's is passed over.
  [[nodiscard]] bool skips_one(std::size_t i, std::size_t k) const {
    return lengths_[(i + 1) * columns_ + k] >= lengths_[i * columns_ + k + 1];
  }

 private:
  std::uint32_t& at(std::size_t i, std::size_t k) { return lengths_[i * columns_ + k]; }

  const Exchanges& one_;
  const Exchanges& other_;
  std::size_t columns_;
  std::vector<std::uint32_t> lengths_;
};

// What stands between two equal writes: changed ones in pairs, then what one tape has alone.
void add_between(std::size_t from, std::size_t to, std::size_t new_from, std::size_t new_to,
                 std::vector<WriteDifference>& out) {
  while (from < to || new_from < new_to) {
    WriteDifference difference;
    if (from < to) difference.old_number = ++from;
    if (new_from < new_to) difference.new_number = ++new_from;
    out.push_back(difference);
  }
}

}  // namespace

Result<Exchanges> read_exchanges(const TapePaths& tape, std::size_t most) {
  Result<TapeReader> reader = TapeReader::open(tape);
  if (!reader) return reader.error();
  Exchanges all;
  std::size_t size = 0;
  for (;;) {
    const Result<std::optional<Record>> next = reader->next();
    if (!next) return next.error();
    if (!*next) return all;
    const Record& record = **next;
    if (record.kind != RecordKind::read && record.kind != RecordKind::write) continue;
    if ((size += record.data.size()) > most) {
      return make_error(Errc::usage, fmt::format("tape {} has more than {} MiB, which are not compared",
                                                 in_quotes(tape.name()), most >> 20U));
    }
    const bool writes = record.kind == RecordKind::write;
    if (all.empty() || (writes && !all.back().read.empty())) all.emplace_back();
    Bytes& bytes = writes ? all.back().write : all.back().read;
    bytes.insert(bytes.end(), record.data.begin(), record.data.end());
  }
}

std::vector<WriteDifference> compare_writes(const Exchanges& old_tape, const Exchanges& new_tape) {
  std::vector<WriteDifference> out;
  std::size_t i = 0;
  std::size_t k = 0;
  while (i < old_tape.size() && k < new_tape.size() && old_tape[i].write == new_tape[k].write) ++i, ++k;
  if ((old_tape.size() - i + 1) * (new_tape.size() - k + 1) > kMostCells) {
    for (; i < old_tape.size() || k < new_tape.size(); ++i, ++k) {
      const bool both = i < old_tape.size() && k < new_tape.size();
      if (!both || old_tape[i].write != new_tape[k].write)
        add_between(std::min(i, old_tape.size()), std::min(i + 1, old_tape.size()),
                    std::min(k, new_tape.size()), std::min(k + 1, new_tape.size()), out);
    }
    return out;
  }
  const Exchanges old_rest(old_tape.begin() + static_cast<std::ptrdiff_t>(i), old_tape.end());
  const Exchanges new_rest(new_tape.begin() + static_cast<std::ptrdiff_t>(k), new_tape.end());
  const Alignment alignment(old_rest, new_rest);
  std::size_t old_at = 0;
  std::size_t new_at = 0;
  std::size_t old_from = 0;
  std::size_t new_from = 0;
  while (old_at < old_rest.size() && new_at < new_rest.size()) {
    if (alignment.same(old_at, new_at)) {
      add_between(i + old_from, i + old_at, k + new_from, k + new_at, out);
      old_from = ++old_at;
      new_from = ++new_at;
    } else if (alignment.skips_one(old_at, new_at)) {
      ++old_at;
    } else {
      ++new_at;
    }
  }
  add_between(i + old_from, old_tape.size(), k + new_from, new_tape.size(), out);
  return out;
}

}  // namespace porttape
