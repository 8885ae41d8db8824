#include "tools/suite_file.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <exception>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/rules/toml_table.hpp"  // toml++, set up as it must be in all sources
#include "libport/tape/tape_name.hpp"
#include "tools/test_request.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 3> kOwnKeys = {"name", "command", "skip"};

// Options that are of the whole suite.
bool is_of_a_test(const OptionSpec& spec) { return spec.name != "report" && spec.name != "junit"; }

// What is wrong, thrown to where the file is known.
class SuiteProblem : public std::exception {
 public:
  SuiteProblem(const toml::node& node, std::string text)
      : line_(node.source().begin.line), text_(std::move(text)) {}
  [[nodiscard]] auto line() const { return line_; }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  toml::source_index line_;
  std::string text_;
};

std::string number_text(double number) {
  std::array<char, 40> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), number).ptr};
}

std::string text_of(std::string_view key, const toml::node& node) {
  if (const auto* const text = node.as_string()) return text->get();
  throw SuiteProblem(node, fmt::format("key '{}' is no text; write it in quotes", key));
}

// Nothing: a flag that is off.
std::optional<std::string> value_of(const OptionSpec& spec, const toml::node& node) {
  std::string text;
  if (const auto* const flag = node.as_boolean()) {
    if (!flag->get()) return std::nullopt;
    text = "1";
  } else if (const auto* const integer = node.as_integer()) {
    text = std::to_string(integer->get());
  } else if (const auto* const number = node.as_floating_point()) {
    text = number_text(number->get());
  } else {
    text = text_of(spec.name, node);
  }
  const bool is_flag = spec.kind == OptionSpec::Kind::flag;
  if (is_flag && !node.is_boolean())
    throw SuiteProblem(node, fmt::format("key '{}' is true or false", spec.name));
  const Result<std::string> checked = is_flag ? Result<std::string>(text) : check_value(spec, text);
  if (!checked) throw SuiteProblem(node, fmt::format("key '{}': {}", spec.name, checked.error().message));
  return *checked;
}

// A list: program and arguments; a text: a line for the shell.
std::vector<std::string> command_of(const toml::node& node) {
  std::vector<std::string> command;
  if (const auto* const list = node.as_array()) {
    for (const toml::node& word : *list) command.push_back(text_of("command", word));
  } else {
    command = {"/bin/sh", "-c", text_of("command", node)};
  }
  if (command.empty()) throw SuiteProblem(node, "key 'command' is empty; write [\"PROGRAM\", \"{port}\"]");
  return command;
}

// What is wrong with the folder itself.
class FolderProblem : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class SuiteReader {
 public:
  SuiteReader(std::string folder, const std::map<std::string, std::string>& for_all)
      : options_(test_options()), for_all_(for_all) {
    std::erase_if(options_, [](const OptionSpec& spec) { return !is_of_a_test(spec); });
    suite_.folder = std::move(folder);
  }

  Suite read(const toml::table& file) {
    for (const auto& [key, node] : file) {
      if (key.str() == "name") throw SuiteProblem(node, "key 'name' is of one test; write it in a [[test]]");
      if (key.str() != "test") take(key.str(), node, general_);
    }
    if (const toml::node* const tests = file.get("test")) {
      const toml::array* const list = tests->as_array();
      if (list == nullptr || !list->is_homogeneous<toml::table>())
        throw SuiteProblem(*tests, "key 'test' is no list of tables; write [[test]] before each");
      for (const toml::node& test : *list) add(*test.as_table());
    }
    add_tapes();
    return std::move(suite_);
  }

 private:
  void take(std::string_view key, const toml::node& node, SuiteTest& test) const {
    if (key == "name") {
      test.name = text_of(key, node);
    } else if (key == "command") {
      test.command = command_of(node);
    } else if (key == "skip") {
      test.skip = text_of(key, node);
    } else if (const auto option = std::ranges::find(options_, key, &OptionSpec::name);
               option != options_.end()) {
      if (auto value = value_of(*option, node)) {
        test.values[std::string(key)] = std::move(*value);
      } else {
        test.values.erase(std::string(key));
      }
    } else {
      throw SuiteProblem(node, unknown(key));
    }
  }

  [[nodiscard]] std::string unknown(std::string_view key) const {
    std::vector<std::string_view> known(kOwnKeys.begin(), kOwnKeys.end());
    known.emplace_back("test");
    for (const OptionSpec& spec : options_) known.push_back(spec.name);
    return fmt::format("unknown key {}{}", in_quotes(key), did_you_mean(key, known));
  }

  void add(const toml::table& table) {
    SuiteTest test = general_;
    for (const auto& [key, node] : table) take(key.str(), node, test);
    if (!test.values.contains("tape"))
      throw SuiteProblem(table, "key 'tape' is missing: the tape's name, from this folder on");
    if (test.command.empty() && test.skip.empty())
      throw SuiteProblem(table, "key 'command' is missing, here and at the top of the file");
    if (test.name.empty()) test.name = plain_name(test.values.at("tape"));
    check_new_name(test, table);
    lines_[test.name.raw()] = &table;
    tapes_.insert(tape_path(test.values.at("tape")));
    suite_.tests.push_back(std::move(test));
  }

  void check_new_name(const SuiteTest& test, const toml::node& where) {
    if (names_.insert(test.name.raw()).second) return;
    throw SuiteProblem(where,
                       fmt::format("a second test is named {}; give it a name of its own, name = \"…\"",
                                   test.name.in_quotes()));
  }

  // The names of the folder's files.
  [[nodiscard]] std::set<std::string> files() const {
    std::set<std::string> files;
    std::error_code error;
    for (fs::directory_iterator each(suite_.folder, error), end; !error && each != end; each.increment(error))
      files.insert(each->path().filename().string());
    if (error)
      throw FolderProblem(
          fmt::format("folder {} cannot be read: {}", in_quotes(suite_.folder), error.message()));
    return files;
  }

  // The folder's tapes that no test names: with a command for all they are tests, too.
  void add_tapes() {
    const std::set<std::string> all = files();
    std::set<std::string> found;
    for (const std::string& file : all) {
      // A tape of which only the events are left is a test, too, and one that fails.
      if (file.ends_with(".logr") || file.ends_with(".logw") || file.ends_with(".loge"))
        found.insert(file.substr(0, file.size() - 1));
    }
    note_other_tapes(all);
    std::vector<std::string> without;
    std::vector<std::string> later;
    for (const std::string& tape : found) {
      if (!tapes_.contains(tape_path(tape)))
        (is_later_connection(tape, found) ? later : without).push_back(tape);
    }
    add_tests(without);
    for (const std::string& tape : later) note_later_connection(tape);
  }

  void add_tests(const std::vector<std::string>& without) {
    if (without.empty()) return;
    if (general_.command.empty()) {
      suite_.notes.push_back(fmt::format("no test has {}; give each a [[test]], or all a command at the top",
                                         fmt::join(without, ", ")));
      return;
    }
    for (const std::string& tape : without) {
      SuiteTest test = general_;
      test.name = plain_name(tape);
      test.values["tape"] = tape;
      if (!names_.insert(test.name.raw()).second) {
        throw SuiteProblem(
            *lines_.at(test.name.raw()),
            fmt::format("the test of tape {} is named {}, as is that of the folder's tape {}; "
                        "give it another name, name = \"…\"",
                        in_quotes(named_tape(test.name.raw())), test.name.in_quotes(), in_quotes(tape)));
      }
      suite_.tests.push_back(std::move(test));
    }
  }

  // A test plays all connections of its tape only with the option for it.
  void note_later_connection(const std::string& tape) {
    const std::string first = fs::path(tape).stem().stem().string() + ".log";
    const std::string path = tape_path(first);
    const bool is_played = std::ranges::any_of(suite_.tests, [&](const SuiteTest& test) {
      if (tape_path(test.values.at("tape")) != path) return false;
      const auto told = for_all_.find("connections");
      const auto own = test.values.find("connections");
      return told != for_all_.end() ? told->second == "each"
                                    : own != test.values.end() && own->second == "each";
    });
    if (is_played) return;
    suite_.notes.push_back(fmt::format(
        "no test plays {}, a later connection of {}; connections = \"each\" plays it", tape, first));
  }

  // Tapes whose names do not end in .log are not sought, since any file may end in r or w.
  void note_other_tapes(const std::set<std::string>& all) {
    std::vector<std::string> others;
    for (const std::string& file : all) {
      const std::string tape = file.substr(0, file.size() - 1);
      if (!file.ends_with('r') || tape.empty() || tape.ends_with(".log") || !all.contains(tape + 'w'))
        continue;
      if (!tapes_.contains(tape_path(tape))) others.push_back(tape);
    }
    if (others.empty()) return;
    suite_.notes.push_back(fmt::format(
        "no test has {}, whose name does not end in .log; give each a [[test]]", fmt::join(others, ", ")));
  }

  [[nodiscard]] const std::string& named_tape(const std::string& test) const {
    return std::ranges::find(suite_.tests, test, &SuiteTest::name)->values.at("tape");
  }

  // `x.c2.log` of a recording whose first connection is `x.log`.
  static bool is_later_connection(const std::string& tape, const std::set<std::string>& all) {
    const fs::path inner = fs::path(tape).stem();
    const std::string part = inner.extension().string();
    if (!part.starts_with(".c")) return false;
    const auto number = whole_number<unsigned>(std::string_view(part).substr(2));
    return number && *number >= 2 && part[2] != '0' && all.contains(inner.stem().string() + ".log");
  }

  static std::string plain_name(const std::string& tape) {
    return tape.size() > 4 && tape.ends_with(".log") ? tape.substr(0, tape.size() - 4) : tape;
  }

  [[nodiscard]] std::string tape_path(const std::string& tape) const {
    const std::string path = (fs::path(suite_.folder) / tape).string();
    const auto found = find_tape(path);
    std::error_code error;
    const fs::path plain = fs::weakly_canonical(found ? found->name() : path, error);
    return error ? path : plain.string();
  }

  std::vector<OptionSpec> options_;
  const std::map<std::string, std::string>& for_all_;
  SuiteTest general_;
  Suite suite_;
  std::set<std::string> names_;
  std::map<std::string, const toml::table*> lines_;  // of each [[test]], by its name
  std::set<std::string> tapes_;
};

}  // namespace

Result<Suite> read_suite(const std::string& folder, const std::map<std::string, std::string>& for_all) {
  const std::string file = (fs::path(folder) / kSuiteFile).string();
  std::error_code error;
  if (!fs::is_regular_file(file, error)) {
    return make_error(Errc::usage, fmt::format("suite {}: there is no {} in it; `porttape test --help` tells "
                                               "what one is, tools/SUITE.md its keys",
                                               in_quotes(folder), kSuiteFile));
  }
  std::ifstream in(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (!in) return make_error(Errc::usage, fmt::format("{} cannot be read", in_quotes(file)));
  const toml::parse_result parsed = parse_toml(text, file);
  if (!parsed) {
    return make_error(Errc::usage, fmt::format("{}:{}: {}", file, parsed.error().source().begin.line,
                                               parsed.error().description()));
  }
  try {
    Suite suite = SuiteReader(folder, for_all).read(parsed.table());
    if (suite.tests.empty()) return make_error(Errc::usage, fmt::format("suite {}: no test is in it", file));
    return suite;
  } catch (const SuiteProblem& problem) {
    return make_error(Errc::usage, fmt::format("{}:{}: {}", file, problem.line(), problem.text()));
  } catch (const FolderProblem& problem) {
    return make_error(Errc::usage, fmt::format("suite {}: {}", file, problem.what()));
  }
}

}  // namespace porttape
