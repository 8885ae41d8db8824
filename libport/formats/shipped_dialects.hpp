#pragma once

#include <span>
#include <string_view>

namespace porttape {

// A dialect that comes with porttape: a file of dialects/, built in.
struct ShippedDialect {
  std::string_view name;  // the file's, without its suffix
  std::string_view toml;
};
std::span<const ShippedDialect> shipped_dialects();

}  // namespace porttape
