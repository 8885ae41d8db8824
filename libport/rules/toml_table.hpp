#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// Without exceptions, and in the sources of this room alone.
#define TOML_EXCEPTIONS 0
#define TOML_ENABLE_FORMATTERS 0
// It asserts of a table's header, or lets the compiler assume, what is not so in "[=]"; its parser then
// refuses that.
#define TOML_ASSERT(expression) static_assert(true)
#pragma push_macro("NDEBUG")
#undef NDEBUG
#ifdef __clang__
// In a text that is no TOML it may still ask of such a letter (see parse_toml); either answer ends in an
// error.
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wignored-attributes"
#pragma clang attribute push(__attribute__((no_sanitize("unreachable"))), apply_to = function)
#endif
#include <toml++/toml.h>
#ifdef __clang__
#pragma clang attribute pop
#pragma clang diagnostic pop
#endif
#pragma pop_macro("NDEBUG")

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"

namespace porttape {

// Of letters like ä outside strings and comments, where TOML has none, toml++ asks whether they are white
// space in a way that has no answer. The first one, or a quote in the middle of a word, becomes a ?, which it
// refuses, and ends the text.
toml::parse_result parse_toml(std::string text, const std::string& file);

// What is wrong in a file, by line; all of it is told at once.
class Problems {
 public:
  explicit Problems(std::string file) : file_(std::move(file)) {}

  void tell(std::size_t line, std::string what) { problems_.emplace_back(line, std::move(what)); }
  [[nodiscard]] bool any() const { return !problems_.empty(); }
  [[nodiscard]] Error error();

 private:
  std::string file_;
  std::vector<std::pair<std::size_t, std::string>> problems_;
};

// A table of a TOML file, whose keys are asked for one by one. A value of the wrong kind is told and counts
// as absent; no_others() tells of keys that nobody asked for. Refers to the table and the problems.
class TomlTable {
 public:
  // `name` as messages have it: "[[rule]] 'time'".
  TomlTable(const toml::table& table, std::string name, Problems& problems)
      : table_(table), name_(std::move(name)), problems_(problems) {}

  [[nodiscard]] bool has(std::string_view key) const { return table_.contains(key); }
  [[nodiscard]] bool is_table(std::string_view key) const {
    const toml::node* node = table_.get(key);
    return node != nullptr && node->is_table();
  }
  // The key is known, and read elsewhere.
  void asks(std::string_view key) { asked_.emplace(key); }
  [[nodiscard]] std::size_t line() const { return table_.source().begin.line; }
  [[nodiscard]] std::size_t line_of(std::string_view key) const;

  std::optional<std::string> text(std::string_view key);
  std::optional<std::int64_t> integer(std::string_view key, std::int64_t least, std::int64_t most);
  std::optional<double> number(std::string_view key, double least, double most);
  // Absent: false.
  bool flag(std::string_view key);
  // The place among the words.
  std::optional<std::size_t> choice(std::string_view key, std::span<const std::string_view> words);
  // Two numbers in rising order, [least, most].
  std::optional<std::pair<double, double>> range(std::string_view key);
  // From the text at `key`, or the hexadecimal digits (with spaces) at `key_hex`.
  std::optional<Bytes> bytes(std::string_view key);
  std::optional<Bytes> hex(std::string_view key);
  std::optional<TomlTable> table(std::string_view key);

  void no_others();
  // "key 'x' of [[rule]] 'time' …"
  void wrong(std::string_view key, std::string_view what);
  // The table as a whole.
  void wrong(std::string_view what);
  void set_name(std::string name) { name_ = std::move(name); }
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  const toml::node* get(std::string_view key);
  void wrong_kind(std::string_view key, const toml::node& node, std::string_view accepted);

  const toml::table& table_;
  std::string name_;
  Problems& problems_;
  std::set<std::string, std::less<>> asked_;
};

}  // namespace porttape
