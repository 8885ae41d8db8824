#include "libport/pack/pack_manifest.hpp"

#include <algorithm>
#include <charconv>
#include <limits>
#include <set>

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/utf8.hpp"
#include "libport/tape/payload_totals.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

constexpr std::string_view kPackFormat = "porttape-pack";
constexpr std::size_t kLongestName = 255;

Error wrong_manifest(const std::string& what) {
  return make_error(Errc::io, std::string(kManifestName) + " " + what);
}

std::string text_at(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const json::string* text = value == nullptr ? nullptr : value->if_string();
  return text == nullptr ? std::string() : std::string(text->data(), text->size());
}

const json::array& list_at(const json::object& object, std::string_view key) {
  static const json::array none;
  const json::value* value = object.if_contains({key.data(), key.size()});
  return value != nullptr && value->is_array() ? value->get_array() : none;
}

std::optional<std::uint64_t> size_at(const json::object& object) {
  const json::value* value = object.if_contains("size");
  if (value == nullptr) return std::nullopt;
  if (const auto* number = value->if_uint64()) return *number;
  const auto* number = value->if_int64();
  return number != nullptr && *number >= 0 ? std::optional(static_cast<std::uint64_t>(*number))
                                           : std::nullopt;
}

std::optional<std::uint64_t> digest_of(const std::string& text) {
  std::uint64_t digest = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), digest, 16);
  const bool whole = text.size() == 16 && read.ec == std::errc() && read.ptr == text.data() + text.size();
  return whole ? std::optional(digest) : std::nullopt;
}

Result<std::vector<PackedFile>> files_of(const json::object& object) {
  std::vector<PackedFile> files;
  std::set<std::string> names = {std::string(kManifestName)};
  std::uint64_t all = 0;
  for (const json::value& value : list_at(object, "files")) {
    if (!value.is_object()) return wrong_manifest("has a file that is no object");
    PackedFile file{.name = text_at(value.get_object(), "name")};
    if (!is_plain_name(file.name))
      return wrong_manifest("names a file " + in_quotes(file.name) + ", which is no plain name");
    if (!names.insert(file.name).second) return wrong_manifest("names " + in_quotes(file.name) + " twice");
    const auto size = size_at(value.get_object());
    const auto digest = digest_of(text_at(value.get_object(), "xxh3"));
    if (!size || !digest) return wrong_manifest("has no size or no xxh3 of " + in_quotes(file.name));
    if (__builtin_add_overflow(all, *size, &all)) return wrong_manifest("tells of impossibly many bytes");
    file.size = *size;
    file.xxh3 = *digest;
    files.push_back(std::move(file));
  }
  if (files.empty()) return wrong_manifest("tells of no files");
  return files;
}

Result<PackedTape> tape_of(const json::value& value, const std::set<std::string_view>& files) {
  if (!value.is_object()) return wrong_manifest("has a tape that is no object");
  PackedTape tape{text_at(value.get_object(), "name"),
                  text_at(value.get_object(), "id"),
                  text_at(value.get_object(), "verdict"),
                  {}};
  if (!is_plain_name(tape.name))
    return wrong_manifest("names a tape " + in_quotes(tape.name) + ", which is no plain name");
  for (const char kind : {'r', 'w', 'e'}) {
    if (files.count(tape.name + kind) > 0) tape.files.push_back(tape.name + kind);
  }
  if (tape.files.empty()) return wrong_manifest("tells of no file of the tape " + in_quotes(tape.name));
  return tape;
}

Result<std::vector<PackedTape>> tapes_of(const json::object& object, const std::vector<PackedFile>& files) {
  std::set<std::string_view> files_told;
  for (const PackedFile& file : files) files_told.insert(file.name);
  std::vector<PackedTape> tapes;
  std::set<std::string> names;
  for (const json::value& value : list_at(object, "tapes")) {
    Result<PackedTape> tape = tape_of(value, files_told);
    if (!tape) return tape.error();
    if (!names.insert(tape->name).second)
      return wrong_manifest("names the tape " + in_quotes(tape->name) + " twice");
    tapes.push_back(std::move(*tape));
  }
  if (tapes.empty()) return wrong_manifest("tells of no tape");
  return tapes;
}

// A pack holds the files of its tapes and the report of a redaction.
Result<void> check_files(const PackManifest& manifest) {
  std::set<std::string_view> known;
  if (manifest.redaction) known.insert(kRedactionName);
  for (const PackedTape& tape : manifest.tapes) known.insert(tape.files.begin(), tape.files.end());
  for (const PackedFile& file : manifest.files) {
    if (!known.contains(file.name))
      return wrong_manifest("names a file " + in_quotes(file.name) +
                            ", which belongs to none of its tapes and is no report of a redaction");
  }
  return {};
}

}  // namespace

const PackedFile* PackManifest::file(std::string_view name) const {
  const auto found =
      std::find_if(files.begin(), files.end(), [&](const PackedFile& each) { return each.name == name; });
  return found == files.end() ? nullptr : &*found;
}

std::uint64_t PackManifest::bytes() const {
  std::uint64_t all = 0;
  for (const PackedFile& each : files) all += each.size;
  return all;
}

bool is_plain_name(std::string_view name) {
  if (name.empty() || name.size() > kLongestName || name.front() == '.' || name.front() == '-') return false;
  while (!name.empty()) {
    const std::size_t length = utf8_length(name);
    if (length == 0 || name.front() == '/' || name.front() == '\\') return false;
    if (is_obeyed(utf8_character(name.substr(0, length)))) return false;
    name.remove_prefix(length);
  }
  return true;
}

std::string to_json(const PackManifest& manifest) {
  JsonList tapes;
  for (const PackedTape& tape : manifest.tapes) {
    JsonList files;
    for (const std::string& name : tape.files) files.add(name);
    JsonObject object;
    object.add("name", tape.name);
    if (!tape.id.empty()) object.add("id", tape.id);
    tapes.add(object.add("verdict", tape.verdict).add("files", files));
  }
  JsonList files;
  for (const PackedFile& file : manifest.files)
    files.add(JsonObject().add("name", file.name).add("size", file.size).add("xxh3", digest_text(file.xxh3)));
  JsonObject object;
  object.add("format", kPackFormat)
      .add("version", 1)
      .add("created", manifest.created)
      .add("tool", manifest.tool);
  object.add("tapes", tapes).add("files", files);
  if (!manifest.driver_version.empty() || !manifest.driver_command.empty()) {
    JsonObject driver;
    if (!manifest.driver_version.empty()) driver.add("version", manifest.driver_version);
    if (!manifest.driver_command.empty()) driver.add("command", manifest.driver_command);
    object.add("driver", driver);
  }
  if (manifest.redaction) object.add("redaction", kRedactionName);
  if (!manifest.system.empty()) {
    JsonObject system;
    for (const auto& [key, value] : manifest.system) system.add(key, value);
    object.add("system", system);
  }
  return object.str() + "\n";
}

Result<PackManifest> read_manifest(std::string_view text) {
  json::error_code failed;
  const json::value value = json::parse({text.data(), text.size()}, failed);
  if (failed || !value.is_object()) return wrong_manifest("is no JSON object");
  const json::object& object = value.get_object();
  if (text_at(object, "format") != kPackFormat) return wrong_manifest("is not one of porttape pack");
  const json::value* version = object.if_contains("version");
  if (version == nullptr || *version != 1)
    return wrong_manifest("is of another version; this porttape reads version 1");
  PackManifest manifest{.created = text_at(object, "created"), .tool = text_at(object, "tool")};
  Result<std::vector<PackedFile>> files = files_of(object);
  if (!files) return files.error();
  manifest.files = std::move(*files);
  Result<std::vector<PackedTape>> tapes = tapes_of(object, manifest.files);
  if (!tapes) return tapes.error();
  manifest.tapes = std::move(*tapes);
  if (const json::value* driver = object.if_contains("driver"); driver != nullptr && driver->is_object()) {
    manifest.driver_version = text_at(driver->get_object(), "version");
    manifest.driver_command = text_at(driver->get_object(), "command");
  }
  manifest.redaction = object.contains("redaction");
  if (manifest.redaction && manifest.file(kRedactionName) == nullptr)
    return wrong_manifest("tells of a redaction, and of no " + std::string(kRedactionName));
  if (const Result<void> checked = check_files(manifest); !checked) return checked.error();
  if (const json::value* system = object.if_contains("system"); system != nullptr && system->is_object()) {
    for (const auto& member : system->get_object()) {
      const std::string key(member.key().data(), member.key().size());
      manifest.system.emplace_back(key, text_at(system->get_object(), key));
    }
  }
  return manifest;
}

}  // namespace porttape
