#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// A text log, by the dialect in the file that options().dialect names.
Result<std::optional<TapeTime>> import_dialect(Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress);

// The same by the dialects that come with porttape.
enum class ShippedDialect : std::uint8_t {
  python_hex,
  zwave_js,
  octoprint,
  minicom,
  picocom,
  interceptty,
  ser2net
};
inline constexpr std::size_t kShippedDialects = 7;
Result<std::optional<TapeTime>> import_shipped(ShippedDialect which, Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress);
int detect_shipped(ShippedDialect which, std::string_view head);

template <ShippedDialect kWhich>
Result<std::optional<TapeTime>> import_shipped(Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress) {
  return import_shipped(kWhich, from, to, progress);
}
template <ShippedDialect kWhich>
int detect_shipped(std::string_view head) {
  return detect_shipped(kWhich, head);
}

}  // namespace porttape
