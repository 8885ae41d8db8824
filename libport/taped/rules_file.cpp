#include "libport/taped/rules_file.hpp"

#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>

#include "libport/base/printable.hpp"
#include "libport/rules/rules_reader.hpp"

namespace porttape {
namespace {

constexpr std::size_t kLargest = std::size_t{1} << 20;

}  // namespace

Result<RuleSet> read_rules_file(const std::string& path) {
  if (path == "-")
    return make_error(Errc::usage, "rules file '-': name a file; standard input is /dev/stdin");
  std::error_code error;
  std::ifstream file(path, std::ios::binary);
  const bool directory = std::filesystem::is_directory(path, error);
  if (directory) errno = EISDIR;
  if (!file || directory) {
    return make_error(Errc::usage,
                      fmt::format("rules file {}: {}; name a TOML file, see porttape rules check --help",
                                  in_quotes(path), errno_text(errno)));
  }
  // It may have no end.
  std::string text(kLargest + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (file.bad()) return make_error(Errc::io, fmt::format("rules file {} cannot be read", in_quotes(path)));
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kLargest) {
    return make_error(Errc::usage,
                      fmt::format("rules file {} has more than a megabyte; is it one?", in_quotes(path)));
  }
  return read_rules(text, path);
}

}  // namespace porttape
