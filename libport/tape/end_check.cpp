#include "libport/tape/end_check.hpp"

#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <system_error>
#include <utility>

namespace porttape {
namespace {

std::string totals_text(const PayloadTotals& totals, bool with_digest) {
  std::string text = fmt::format("{} block{}, {} byte{}", totals.blocks, totals.blocks == 1 ? "" : "s",
                                 totals.bytes, totals.bytes == 1 ? "" : "s");
  if (!with_digest || !totals.xxh3) return text;
  return text + ", xxh3 " + digest_text(*totals.xxh3);
}

// A digest that is not told fits any.
bool fits(const HeldFile& file, const PayloadTotals& told) {
  const PayloadTotals& held = file.totals;
  return held.blocks == told.blocks && held.bytes == told.bytes &&
         (!held.xxh3 || !told.xxh3 || held.xxh3 == told.xxh3) &&
         (!held.xxh3_all || !told.xxh3_all || held.xxh3_all == told.xxh3_all);
}

// An r or w file beside what the `end` event tells of it.
struct CheckedFile {
  const HeldFile& file;
  PayloadTotals told;

  [[nodiscard]] bool as_told() const { return fits(file, told); }
  [[nodiscard]] bool is_wrong() const { return !file.damaged && !as_told(); }
  // Vouches for the events file: bytes that another tape would hardly have.
  [[nodiscard]] bool vouches() const { return file.exists && as_told() && told.bytes > 0; }
};

std::string what_is_wrong(const CheckedFile& checked, const CheckedFile& other, const std::string& events) {
  const HeldFile& file = checked.file;
  const PayloadTotals& held = file.totals;
  const bool same_size = held.blocks == checked.told.blocks && held.bytes == checked.told.bytes;
  const std::string told = events + " tells of " + totals_text(checked.told, same_size);
  if (!file.exists) return file.path + " is missing: " + told;
  if (same_size && held.xxh3 && held.xxh3 == checked.told.xxh3)
    return fmt::format("{} has other times or lengths of blocks: their xxh3_all is {}, and {} tells of {}",
                       file.path, digest_text(*held.xxh3_all), events, digest_text(*checked.told.xxh3_all));
  const std::string holds = ": it holds " + totals_text(held, same_size) + "; " + told;
  if (fits(file, other.told)) return file.path + " is what belongs in " + other.file.path + holds;
  const bool less = held.blocks <= checked.told.blocks && held.bytes <= checked.told.bytes && !same_size;
  return file.path + (less ? " is shortened, or another tape's" : " is another tape's, or changed") + holds;
}

}  // namespace

EndFindings compare_with_end(const HeldFile& read, const HeldFile& write, const event::End& end,
                             const std::string& events) {
  const CheckedFile r{read, *end.read};
  const CheckedFile w{write, *end.write};
  EndFindings found;
  if (r.is_wrong() && w.is_wrong() && fits(read, w.told) && fits(write, r.told)) {
    found.damages.push_back(read.path + " and " + write.path + " are swapped: each holds what " + events +
                            " tells of the other");
    return found;
  }
  if (r.is_wrong()) found.damages.push_back(what_is_wrong(r, w, events));
  if (w.is_wrong()) found.damages.push_back(what_is_wrong(w, r, events));
  const bool foreign_content = (r.is_wrong() && read.exists) || (w.is_wrong() && write.exists);
  if (foreign_content && !r.vouches() && !w.vouches())
    found.damages.push_back(events + " may be another tape's itself: nothing beside it is what it tells of");
  for (const CheckedFile* checked : {&r, &w}) {
    if (!checked->file.exists && checked->as_told())
      found.notes.push_back(checked->file.path + " is missing; it held nothing");
  }
  return found;
}

bool has_digests(const std::optional<TapeHeader>& header) { return header && !header->id.empty(); }

EndCheck::Names EndCheck::Names::of(const TapePaths& tape) {
  std::error_code unknown;
  return {tape.read.string(), tape.write.string(), tape.events.string(),
          std::filesystem::exists(tape.read, unknown), std::filesystem::exists(tape.write, unknown)};
}

EndCheck::EndCheck(Names names, const std::optional<TapeHeader>& header)
    : names_(std::move(names)),
      with_digest_(has_digests(header)),
      read_(with_digest_),
      write_(with_digest_) {}

void EndCheck::pass(const Record& record) {
  if (record.event != nullptr) {
    const auto* end = std::get_if<event::End>(record.event);
    end_ = end != nullptr ? std::optional(*end) : std::nullopt;
    return;
  }
  PayloadCounter& counter = record.kind == RecordKind::read ? read_ : write_;
  if (record.piece_offset == 0) counter.begin_block(record.at, record.block_length);
  counter.add(record.data);
}

void EndCheck::rewind() {
  read_ = PayloadCounter(with_digest_);
  write_ = PayloadCounter(with_digest_);
  end_.reset();
}

std::optional<Error> EndCheck::flaw() const {
  if (!end_ || !end_->read || !end_->write) return std::nullopt;
  const EndFindings found = compare_with_end(
      {.path = names_.read, .exists = names_.has_read, .totals = read_.totals()},
      {.path = names_.write, .exists = names_.has_write, .totals = write_.totals()}, *end_, names_.events);
  if (found.damages.empty()) return std::nullopt;
  return make_error(Errc::damaged_tape, fmt::format("{}", fmt::join(found.damages, "; ")));
}

}  // namespace porttape
