#include "tools/view_writer.hpp"

#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/tape/difference_reader.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tools/diff_words.hpp"
#include "tools/view_packer.hpp"
#include "tools/view_page.hpp"

namespace porttape {
namespace {

// More are not for eyes; they are counted.
constexpr std::uint64_t kDifferencesOnView = 5000;

std::string data_element(std::string_view kind, std::string_view content) {
  return fmt::format("<script type=\"text/plain\" data-of=\"{}\">{}</script>\n", kind, content);
}

// Where a turn of a difference is.
std::string turn_json(const Turn* turn) {
  if (turn == nullptr) return "null";
  return JsonObject()
      .add("t", to_us(turn->at))
      .add("exchange", turn->exchange)
      .add("part", turn->part)
      .add("event", turn->is_event() ? 1 : 0)
      .str();
}

}  // namespace

Result<void> ViewWriter::begin() { return file_.add(view_page_head()); }

Result<void> ViewWriter::add_tape(const TapePaths& paths) {
  auto tape = TapeReader::open(paths, {.events_may_fail = true});
  if (!tape) return tape.error();
  const std::string kind = fmt::format("tape{}", ++tape_);
  ViewPacker packer([&](std::string_view chunk) { return file_.add(data_element(kind, chunk)); });
  std::string damage;
  for (;;) {
    const auto record = tape->next();
    if (!record && record.error().code == Errc::io) return record.error();
    if (!record) {
      damage = record.error().message;
      damage_.push_back(record.error());
    }
    if (!record || !*record) break;
    done_ += (*record)->data.size() + (*record)->event_line.size();
    if (done_ > kMostViewBytes) return usage_error("the tape has become too large while it was read");
    if (Result<void> added = packer.add(**record); !added) return added;
    progress_(done_);
  }
  if (Result<void> finished = packer.finish(); !finished) return finished;
  JsonObject facts;
  facts.add("name", printable_line(paths.file_name())).add("blocks", packer.blocks());
  facts.add("events", packer.events()).add("read", packer.bytes()[0]).add("written", packer.bytes()[1]);
  facts.add("header", tape->header_line()).add("damage", damage);
  facts.add("torn", tape->torn_tail().value_or(""));
  tapes_.add(facts);
  return {};
}

Result<void> ViewWriter::add_differences(const TapePaths& one, const TapePaths& other, const TapeDiff& diff,
                                         std::optional<Micros> margin) {
  const std::uint64_t all = diff.differences.size();
  const std::uint64_t shown = std::min(all, kDifferencesOnView);
  auto reader = DifferenceReader::open(one, other, diff.differences, {.events = diff.events, .most = shown});
  if (!reader) return reader.error();
  JsonList list;
  for (std::uint64_t number = 0; number < shown; ++number) {
    const Result<ShownDifference> next = reader->next();
    if (!next) return next.error();
    JsonObject item;
    item.add("kind", to_string(next->what.kind)).add("text", headline_of(*next));
    item.add_raw("one", turn_json(next->one)).add_raw("other", turn_json(next->other));
    list.add(item);
  }
  differences_.emplace();
  differences_->add("counts", counts_text(diff)).add("agreement", agreement_text(diff, margin));
  differences_->add("more", all - shown).add("list", list);
  return {};
}

Result<void> ViewWriter::end() {
  JsonObject facts;
  facts.add("tapes", tapes_).add_raw("differences", differences_ ? differences_->str() : "null");
  const Result<std::string> packed = pack_for_page(as_bytes(facts.str()));
  if (!packed) return packed.error();
  if (Result<void> added = file_.add(data_element("facts", *packed)); !added) return added;
  return file_.add(view_page_tail());
}

}  // namespace porttape
