#include "tools/test_lines.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>
#include <vector>

#include "tools/option_description.hpp"

namespace porttape {
namespace {

using Words = std::vector<std::string>;

// Where a command is that is named without a path; empty: nowhere.
std::filesystem::path found(const std::string& program) {
  if (program.find('/') != std::string::npos) return program;
  const char* const path = std::getenv("PATH");
  std::string_view rest = path == nullptr ? "" : path;
  while (!rest.empty()) {
    const std::size_t colon = std::min(rest.find(':'), rest.size());
    const std::filesystem::path here = std::filesystem::path(rest.substr(0, colon)) / program;
    std::error_code unknown;
    if (std::filesystem::is_regular_file(here, unknown)) return here;
    rest.remove_prefix(std::min(colon + 1, rest.size()));
  }
  return {};
}

std::string beginning_of(const std::filesystem::path& file) {
  std::array<char, 64> bytes{};
  std::error_code unknown;
  if (!std::filesystem::is_regular_file(file, unknown)) return {};
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), bytes.size());
  std::string text(bytes.data(), static_cast<std::size_t>(in.gcount()));
  return text.substr(0, text.find('\n'));
}

bool is_shell(std::string_view name) {
  return name == "sh" || name == "bash" || name == "dash" || name == "ksh" || name == "zsh";
}

// The command under a debugger.
Words stepped(const Words& command) {
  const std::filesystem::path file = found(command.front());
  const std::string name = std::filesystem::path(command.front()).filename();
  const std::string beginning = beginning_of(file);
  Words out;
  std::size_t taken = 0;
  if (name.starts_with("python")) {
    out = {command.front(), "-m", "pdb"};
    taken = 1;
  } else if (is_shell(name)) {
    out = {command.front(), "-x"};
    taken = 1;
  } else if (beginning.starts_with("#!") && beginning.find("python") != std::string::npos) {
    out = {"python3", "-m", "pdb"};
  } else if (beginning.starts_with("#!") && beginning.ends_with("sh")) {
    out = {beginning.find("bash") == std::string::npos ? "sh" : "bash", "-x"};
  } else if (beginning.starts_with("\x7f"
                                   "ELF")) {
    out = {"gdb", "--args"};
  }
  out.insert(out.end(), command.begin() + static_cast<std::ptrdiff_t>(taken), command.end());
  return out;
}

Words line_of(Arguments args) {
  Words words{"porttape", "test"};
  words.insert(words.end(), args.begin(), args.end());
  return words;
}

}  // namespace

std::string repeat_line(Arguments args) { return shell_line(line_of(args)); }

std::string step_line(Arguments args) {
  const auto separator = std::ranges::find(args, "--");
  if (separator == args.end() || separator + 1 == args.end()) return repeat_line(args);
  Words words{"porttape", "test", "--timeout", "0"};
  for (auto word = args.begin(); word != separator; ++word) {
    if (*word == "--timeout" && word + 1 != separator) {
      ++word;
    } else if (!word->starts_with("--timeout=")) {
      words.push_back(*word);
    }
  }
  words.emplace_back("--");
  const Words command = stepped(Words(separator + 1, args.end()));
  words.insert(words.end(), command.begin(), command.end());
  return shell_line(words);
}

}  // namespace porttape
