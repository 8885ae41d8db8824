// The text form of a plan, read: FAULTS.md.

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fstream>
#include <iterator>
#include <set>
#include <system_error>
#include <utility>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/faults/fault_keys.hpp"
#include "libport/faults/fault_plan.hpp"

namespace porttape {
namespace {

constexpr std::uintmax_t kLargestFile = 1U << 20U;
constexpr std::string_view kBlanks = " \t\r";

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

// Cuts off what stands before the next of the separators.
std::string_view take_part(std::string_view& text, std::string_view separators) {
  const std::size_t end = std::min(text.find_first_of(separators), text.size());
  const std::string_view part = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return part;
}

std::optional<Fault::Kind> kind_of(std::string_view word) {
  const auto* const found = std::ranges::find(kFaultKinds, word);
  if (found == kFaultKinds.end()) return std::nullopt;
  return static_cast<Fault::Kind>(found - kFaultKinds.begin());
}

// A plan's first word.
std::string_view first_word(std::string_view text) {
  text = trimmed(text);
  return text.substr(0, text.find_first_of(":,;=# \t\r\n"));
}

Error unknown_kind(std::string_view word) {
  std::string end = did_you_mean(word, kFaultKinds);
  if (end.empty()) end = fmt::format("; accepted: {}", fmt::join(kFaultKinds, ", "));
  return usage_error(fmt::format("unknown fault {}{}", in_quotes(word), end));
}

std::vector<std::string_view> keys_of(Fault::Kind kind) {
  std::vector<std::string_view> names;
  for (const FaultKey& key : fault_keys()) {
    if (key.takes(kind)) names.push_back(key.name);
  }
  return names;
}

bool says_when(std::string_view key) { return key == "p" || key == "byte" || key == "frame" || key == "at"; }

// Reads one fault; keeps what was given.
class FaultReader {
 public:
  explicit FaultReader(Fault::Kind kind, std::optional<LineDir> dir) {
    fault_.kind = kind;
    fault_.dir = dir;
    if (kind == Fault::Kind::truncate) fault_.unit = Fault::Unit::frame;
    if (kind == Fault::Kind::corrupt) fault_.unit = Fault::Unit::byte;
    if (kind == Fault::Kind::delay) fault_.length = std::chrono::milliseconds(100);
    if (kind == Fault::Kind::stall || kind == Fault::Kind::replug) fault_.length = std::chrono::seconds(1);
  }

  Result<void> take(std::string_view name, std::string_view value) {
    const auto key = std::ranges::find(fault_keys(), name, &FaultKey::name);
    if (key == fault_keys().end() || !key->takes(fault_.kind)) return unknown_key(name);
    if (!given_.insert(key->name).second)
      return usage_error(fmt::format("{}key '{}' is there twice", of(), name));
    if (!key->read(fault_, value))
      return usage_error(
          fmt::format("{}key '{}' is {}; accepted: {}", of(), name, in_quotes(value), key->accepted));
    return {};
  }

  Result<Fault> done() const {
    const auto whens = std::ranges::count_if(given_, says_when);
    if (whens != 1)
      return usage_error(fmt::format("{}{}; accepted: one of p, byte, frame, at", of(),
                                     whens == 0 ? "it does not say when" : "it says more than once when"));
    if (given_.contains("end") && given_.contains("size"))
      return usage_error(of() + "keys 'end' and 'size' both say what a frame is; accepted: one of them");
    const bool in_frames = fault_.when == Fault::When::chance || fault_.when == Fault::When::frame;
    if (given_.contains("keep") && !in_frames)
      return usage_error(of() + "key 'keep' goes with p and frame, which strike whole frames");
    Fault fault = fault_;
    const bool breaks = fault.kind == Fault::Kind::hangup || fault.kind == Fault::Kind::replug;
    if (breaks && fault.when == Fault::When::time) fault.dir.reset();  // both, whatever comes
    return fault;
  }

 private:
  [[nodiscard]] std::string of() const { return fmt::format("fault '{}': ", to_string(fault_.kind)); }

  [[nodiscard]] Error unknown_key(std::string_view name) const {
    const std::vector<std::string_view> known = keys_of(fault_.kind);
    std::string end = did_you_mean(name, known);
    if (end.empty()) end = fmt::format("; accepted: {}", fmt::join(known, ", "));
    return usage_error(fmt::format("{}unknown key {}{}", of(), in_quotes(name), end));
  }

  Fault fault_;
  std::set<std::string_view> given_;
};

Result<Fault> parse_fault(std::string_view text, std::optional<LineDir> dir) {
  const std::string_view word = trimmed(take_part(text, ":,"));
  const auto kind = kind_of(word);
  if (!kind) return unknown_kind(word);
  FaultReader reader(*kind, dir);
  while (!text.empty()) {
    const std::string_view pair = trimmed(take_part(text, ":,"));
    if (pair.empty()) continue;
    const std::size_t equals = std::min(pair.find('='), pair.size());
    const std::string_view value = pair.substr(std::min(equals + 1, pair.size()));
    if (Result<void> taken = reader.take(trimmed(pair.substr(0, equals)), trimmed(value)); !taken)
      return taken.error();
  }
  return reader.done();
}

// Of one line.
Result<void> add_faults(FaultPlan& plan, std::string_view line, std::optional<LineDir> dir) {
  line = line.substr(0, line.find('#'));
  while (!line.empty()) {
    const std::string_view item = trimmed(take_part(line, ";"));
    if (item.empty()) continue;
    Result<Fault> fault = parse_fault(item, dir);
    if (!fault) return fault.error();
    if (plan.faults.size() == FaultPlan::kMostFaults)
      return usage_error(
          fmt::format("more than {} faults; accepted: as many or fewer", FaultPlan::kMostFaults));
    plan.faults.push_back(std::move(*fault));
  }
  return {};
}

Result<std::string> text_of_file(const std::string& name) {
  const auto fails = [&name](std::string_view why) {
    return usage_error(
        fmt::format("file {} {}; accepted: faults, a line each, such as drop:p=0.01", in_quotes(name), why));
  };
  std::error_code error;
  if (!std::filesystem::is_regular_file(name, error))
    return fails(error ? "cannot be read: " + error.message() : "is no regular file");
  if (std::filesystem::file_size(name, error) > kLargestFile || error) return fails("has more than 1 MiB");
  std::ifstream file(name, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file) return fails("cannot be read");
  return text;
}

}  // namespace

Result<FaultPlan> parse_fault_plan(std::string_view text, std::optional<LineDir> dir) {
  FaultPlan plan;
  const bool has_lines = text.find('\n') != std::string_view::npos;
  for (std::size_t number = 1; !text.empty(); ++number) {
    if (Result<void> added = add_faults(plan, take_part(text, "\n"), dir); !added)
      return has_lines ? usage_error(fmt::format("line {}: {}", number, added.error().message))
                       : added.error();
  }
  if (plan.faults.empty())
    return usage_error(
        fmt::format("no fault in it; accepted: {}, as in drop:p=0.01", fmt::join(kFaultKinds, ", ")));
  return plan;
}

Result<FaultPlan> load_fault_plan(const std::string& text_or_file, std::optional<LineDir> dir) {
  const std::string_view word = first_word(text_or_file);
  std::error_code error;
  const bool is_file = !kind_of(word) && (text_or_file.find('/') != std::string::npos ||
                                          std::filesystem::exists(text_or_file, error));
  if (!is_file) {
    Result<FaultPlan> plan = parse_fault_plan(text_or_file, dir);
    const bool may_be_file = !plan && !kind_of(word) && word == trimmed(text_or_file) && !word.empty();
    return may_be_file ? usage_error(plan.error().message + "; and there is no file of that name")
                       : std::move(plan);
  }
  const Result<std::string> text = text_of_file(text_or_file);
  if (!text) return text.error();
  Result<FaultPlan> plan = parse_fault_plan(*text, dir);
  if (!plan) return usage_error(fmt::format("file {}: {}", in_quotes(text_or_file), plan.error().message));
  return plan;
}

}  // namespace porttape
