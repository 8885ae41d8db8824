#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/stranger_text.hpp"

namespace porttape {

inline constexpr std::string_view kManifestName = "manifest.json";
inline constexpr std::string_view kRedactionName = "redaction.json";

struct PackedFile {
  std::string name{};
  std::uint64_t size = 0;
  std::uint64_t xxh3 = 0;  // with 64 bits, of all its bytes
  friend bool operator==(const PackedFile&, const PackedFile&) = default;
};

struct PackedTape {
  std::string name{};      // laser.log
  StrangerText id{};       // empty: it has no events file
  StrangerText verdict{};  // to_string() of its judgement when it was packed
  std::vector<std::string> files{};
  friend bool operator==(const PackedTape&, const PackedTape&) = default;
};

// What a pack's first file says of it; PACK.md has the keys.
struct PackManifest {
  StrangerText created{};  // RFC 3339
  StrangerText tool{};     // "porttape VERSION"
  std::vector<PackedTape> tapes{};
  std::vector<PackedFile> files{};
  StrangerText driver_version{};  // as the user gives it
  StrangerText driver_command{};
  bool redaction = false;                                      // kRedactionName is among the files
  std::vector<std::pair<std::string, StrangerText>> system{};  // what the user has agreed to

  [[nodiscard]] const PackedFile* file(std::string_view name) const;
  [[nodiscard]] std::uint64_t bytes() const;  // of all files
  friend bool operator==(const PackManifest&, const PackManifest&) = default;
};

// A name that is one file's, wherever it is unpacked: no folder, well-formed UTF-8, nothing that a terminal
// would obey (is_obeyed()), and no `.` or `-` at its beginning, which would hide it or make it an option.
bool is_plain_name(std::string_view name);

std::string to_json(const PackManifest& manifest);
// Errc::io, whose message says what is wrong. What is given is checked: names are plain and unique, tapes are
// of the files, and each file is a tape's or kRedactionName.
Result<PackManifest> read_manifest(std::string_view json);

}  // namespace porttape
