#pragma once

#include <algorithm>
#include <optional>
#include <string_view>

#include "libport/formats/format.hpp"

namespace porttape {

// A text log, by the dialect in the file that options().dialect names.
Result<std::optional<TapeTime>> import_dialect(Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress);

// The same by a dialect that comes with porttape.
Result<std::optional<TapeTime>> import_shipped(std::string_view dialect, Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress);
int detect_shipped(std::string_view dialect, std::string_view head);

template <std::size_t kSize>
struct DialectName {
  consteval DialectName(const char (&name)[kSize]) { std::ranges::copy(name, text); }  // NOLINT: is a text
  [[nodiscard]] constexpr std::string_view view() const { return {text, kSize - 1}; }
  char text[kSize]{};  // NOLINT: a template's argument
};

// The row of such a dialect among the formats.
template <DialectName kName>
consteval Format shipped_format(std::string_view what) {
  return {kName.view(),
          what,
          [](Evidence& from, ImportTape& to, const ConvertProgress& progress) {
            return import_shipped(kName.view(), from, to, progress);
          },
          nullptr,
          [](std::string_view head) { return detect_shipped(kName.view(), head); },
          ""};
}

}  // namespace porttape
