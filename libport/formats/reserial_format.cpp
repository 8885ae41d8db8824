#include "libport/formats/reserial_format.hpp"

#include <fmt/format.h>

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>

#include "libport/base/printable.hpp"
#include "libport/formats/base64.hpp"
#include "libport/tape/part_writer.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

constexpr std::size_t kLargestFile = std::size_t{64} << 20U;
constexpr std::string_view kExportedTest = "test_tape";
constexpr std::size_t kBlockOfTraffic = 4096;

// Base64, or a list of numbers as the first version had.
std::optional<Bytes> traffic_of(const json::object& test, std::string_view way) {
  const json::value* const value = test.if_contains({way.data(), way.size()});
  if (value == nullptr) return std::nullopt;
  if (const json::string* const text = value->if_string())
    return bytes_of_base64({text->data(), text->size()});
  const json::array* const numbers = value->if_array();
  if (numbers == nullptr) return std::nullopt;
  Bytes bytes;
  for (const json::value& each : *numbers) {
    const std::int64_t* const number = each.if_int64();
    if (number == nullptr || *number < 0 || *number > 0xff) return std::nullopt;
    bytes.push_back(static_cast<Byte>(*number));
  }
  return bytes;
}

bool is_test(const json::value& value) {
  const json::object* const test = value.if_object();
  return test != nullptr && test->if_contains("rx") != nullptr && test->if_contains("tx") != nullptr;
}

Result<std::string> whole_text(Evidence& from) {
  std::string text;
  for (;;) {
    const auto piece = from.peek();
    if (!piece) return piece.error();
    if (piece->empty()) return text;
    text += as_text(*piece);
    if (text.size() > kLargestFile)
      return make_error(Errc::not_a_tape,
                        from.name() + " is over 64 MiB; that is no file of pytest-reserial");
    if (const auto skipped = from.skip(piece->size()); !skipped) return skipped.error();
  }
}

// The test that is asked for, or the only one.
Result<const json::object*> chosen_test(const json::object& all, const Evidence& from, const ImportTape& to) {
  const json::object* chosen = nullptr;
  std::string names;
  std::size_t tests = 0;
  for (const auto& each : all) {
    if (!is_test(each.value())) continue;
    const std::string name(each.key().data(), each.key().size());
    if (++tests <= 20) names += (names.empty() ? "" : ", ") + printable_line(name);
    if (!to.options().device || *to.options().device == name) chosen = &each.value().get_object();
  }
  if (tests == 0)
    return make_error(Errc::not_a_tape,
                      from.name() + " is no file of pytest-reserial: no test with rx and tx");
  if (chosen != nullptr && (to.options().device || tests == 1)) return chosen;
  return usage_error(
      fmt::format("{} has {} tests; say by --device NAME which: {}", from.name(), tests, names));
}

Result<void> put_traffic(ImportTape& to, Direction way, ByteView bytes) {
  while (!bytes.empty()) {
    const ByteView block = bytes.first(std::min(bytes.size(), kBlockOfTraffic));
    if (Result<void> put = to.block(way, std::nullopt, block); !put) return put;
    bytes = bytes.subspan(block.size());
  }
  return {};
}

// One member, all that went one way.
Result<void> add_traffic(TapeReader& from, NewFile& to, RecordKind kind) {
  Bytes left;  // less than three bytes
  for (;;) {
    const auto next = from.next();
    if (!next) return next.error();
    if (!*next) break;
    if ((*next)->kind != kind) continue;
    append(left, (*next)->data);
    const std::size_t whole = left.size() / 3 * 3;
    if (Result<void> added = to.add(to_base64(ByteView(left).first(whole))); !added) return added;
    left.erase(left.begin(), left.begin() + static_cast<std::ptrdiff_t>(whole));
  }
  return to.add(to_base64(left));
}

}  // namespace

Result<std::optional<TapeTime>> import_reserial(Evidence& from, ImportTape& to,
                                                const ConvertProgress& progress) {
  const Result<std::string> text = whole_text(from);
  if (!text) return text.error();
  json::error_code failed;
  const json::value value = json::parse({text->data(), text->size()}, failed);
  const json::object* const all = value.if_object();
  if (failed || all == nullptr)
    return make_error(Errc::not_a_tape, from.name() + " is no file of pytest-reserial: no JSON object");
  const auto test = chosen_test(*all, from, to);
  if (!test) return test.error();
  const auto sent = traffic_of(**test, "tx");
  const auto received = traffic_of(**test, "rx");
  if (!sent || !received)
    return make_error(Errc::damaged_tape, from.name() + ": rx and tx are to be base64, or lists of bytes");
  to.guessed("the driver wrote all before it was answered, since pytest-reserial keeps no order");
  if (!to.options().bytes_at) to.guessed("all bytes came at once, since pytest-reserial has no times");
  if (Result<void> put = to.event(TapeTime{}, event::Open{}); !put) return put.error();
  if (Result<void> put = put_traffic(to, Direction::write, *sent); !put) return put.error();
  // What is equal in time is read writes first.
  if (Result<void> put = put_traffic(to, Direction::read, *received); !put) return put.error();
  if (progress) progress(from.offset());
  return std::optional(to.latest());
}

Result<std::vector<std::string>> export_reserial(TapeReader& from, NewFile& to,
                                                 const ConvertProgress& progress) {
  if (Result<void> added = to.add(fmt::format("{{\"{}\": {{\"rx\": \"", kExportedTest)); !added)
    return added.error();
  if (Result<void> read = add_traffic(from, to, RecordKind::read); !read) return read.error();
  if (Result<void> again = from.rewind(); !again) return again.error();
  if (Result<void> added = to.add("\", \"tx\": \""); !added) return added.error();
  if (Result<void> written = add_traffic(from, to, RecordKind::write); !written) return written.error();
  if (Result<void> added = to.add("\"}}\n"); !added) return added.error();
  if (progress) progress(to.size());
  return std::vector<std::string>{
      fmt::format("the test's name, which is to stand in place of {}", kExportedTest),
      "times, blocks and order", "events"};
}

int detect_reserial(std::string_view head) {
  const std::size_t first = head.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos || head[first] != '{') return 0;
  const std::size_t inner = head.find('{', first + 1);
  if (inner == std::string_view::npos) return 0;
  const std::size_t key = head.find_first_not_of(" \t\r\n", inner + 1);
  const std::string_view rest = key == std::string_view::npos ? std::string_view() : head.substr(key);
  return rest.starts_with("\"rx\"") || rest.starts_with("\"tx\"") ? 80 : 0;
}

}  // namespace porttape
