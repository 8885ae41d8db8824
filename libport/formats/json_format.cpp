#include "libport/formats/json_format.hpp"

#include <fmt/format.h>
#include <limits>

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_text.hpp"
#include "libport/formats/each_record.hpp"
#include "libport/formats/line_import.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

constexpr std::string_view kHeaderBegin = "{\"format\":\"porttape-events\"";
constexpr std::int64_t kLongestBlock = std::numeric_limits<std::uint32_t>::max();

std::optional<std::int64_t> whole_of(const json::object& object, std::string_view key) {
  const json::value* const value = object.if_contains({key.data(), key.size()});
  const std::int64_t* const number = value == nullptr ? nullptr : value->if_int64();
  return number == nullptr || *number < 0 ? std::nullopt : std::optional(*number);
}

std::optional<std::string_view> string_of(const json::object& object, std::string_view key) {
  const json::value* const value = object.if_contains({key.data(), key.size()});
  const json::string* const text = value == nullptr ? nullptr : value->if_string();
  return text == nullptr ? std::nullopt : std::optional(std::string_view(text->data(), text->size()));
}

class JsonImport final : public LineImport {
 public:
  JsonImport(Evidence& from, ImportTape& to) : LineImport(from, to) {}

 private:
  Result<void> at_end() override {
    tape().sure();  // what is not JSON is an error
    if (missing_ == 0) return {};
    return wrong(0, fmt::format("the last block ends {} bytes early", missing_));
  }

  Result<void> take_line() override {
    const std::string_view text = line().text;
    if (text.find_first_not_of(" \t") == std::string_view::npos) return {};
    json::parse_options options;
    options.allow_invalid_utf8 = true;
    json::error_code failed;
    const json::value value = json::parse({text.data(), text.size()}, failed, {}, options);
    const json::object* const object = value.if_object();
    if (failed || object == nullptr)
      return wrong(0, failed ? "no JSON: " + failed.message() : "no JSON object");
    if (Result<void> begun = begin_record(); !begun) return begun;
    // An event may have any key beside its own.
    const bool is_event = object->if_contains("event") != nullptr;
    if (!is_event && object->if_contains("dir") != nullptr) return take_block(*object);
    if (missing_ > 0) return wrong(0, fmt::format("{} bytes of the block before are expected", missing_));
    if (!is_event && object->if_contains("format") != nullptr) return take_header(text, 0);
    return take_event(std::nullopt, text, 0);
  }

  Result<void> take_block(const json::object& object) {
    const auto direction = string_of(object, "dir");
    if (direction != "r" && direction != "w") return wrong(0, "\"dir\" is neither \"r\" nor \"w\"");
    const auto hex = string_of(object, "hex");
    const auto bytes = hex ? bytes_of_hex(*hex) : std::nullopt;
    if (!bytes) return wrong(0, "\"hex\" is no text of pairs of hexadecimal digits");
    const auto size = static_cast<std::int64_t>(bytes->size());
    if (missing_ > 0) {
      if (size > missing_)
        return wrong(0, fmt::format("more than the {} bytes that the block misses", missing_));
      missing_ -= size;
      return placed(tape().add(*bytes));
    }
    const auto at = whole_of(object, "t_us");
    if (!at) return wrong(0, "no \"t_us\", or it is not a number of microseconds");
    const std::int64_t length = whole_of(object, "length").value_or(size);
    if (length < size || length > kLongestBlock)
      return wrong(0, fmt::format("\"length\" is {}, and \"hex\" has {} bytes", length, size));
    if (whole_of(object, "blocks").value_or(1) > 1)
      tape().guessed("bursts of several blocks are one block each");
    missing_ = length - size;
    const auto way = direction == "r" ? Direction::read : Direction::write;
    if (missing_ == 0) return placed(tape().block(way, tape_time_us(*at), *bytes));
    if (Result<void> begun = tape().begin_block(way, tape_time_us(*at), static_cast<std::uint32_t>(length));
        !begun)
      return placed(begun);
    return placed(tape().add(*bytes));
  }

  std::int64_t missing_ = 0;  // of the block that has begun
};

std::string line_of(const Record& record) {
  if (record.event != nullptr) return json_for_terminal(record.event_line) + '\n';
  const char way = record.kind == RecordKind::read ? 'r' : 'w';
  const std::string hex = to_hex(record.data);
  if (record.piece_offset > 0) return fmt::format("{{\"dir\":\"{}\",\"hex\":\"{}\"}}\n", way, hex);
  return fmt::format("{{\"t_us\":{},\"dir\":\"{}\",\"length\":{},\"hex\":\"{}\"}}\n", to_us(record.at), way,
                     record.block_length, hex);
}

}  // namespace

Result<std::optional<TapeTime>> import_json(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return JsonImport(from, to).run(progress);
}

Result<std::vector<std::string>> export_json(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  if (const std::string header = from.header_line(); !header.empty()) {
    if (Result<void> added = to.add(json_for_terminal(header) + '\n'); !added) return added.error();
  }
  const Result<void> all =
      each_record(from, progress, [&](const Record& record) { return to.add(line_of(record)); });
  if (!all) return all.error();
  return std::vector<std::string>{};
}

int detect_json(std::string_view head) {
  if (head.starts_with(kHeaderBegin)) return 100;
  return head.starts_with("{\"t_us\":") ? 90 : 0;
}

}  // namespace porttape
