#include "libport/rules/byte_pattern.hpp"

#include <fmt/format.h>
#include <re2/re2.h>

#include "libport/base/printable.hpp"
#include "libport/rules/frame_place.hpp"

namespace porttape {

Result<BytePattern> BytePattern::compile(const std::string& expression) {
  auto compiled = std::make_shared<const re2::RE2>(expression, rule_expression_options());
  if (compiled->ok()) return BytePattern(std::move(compiled));
  return make_error(Errc::usage, fmt::format("{} is no regular expression: {}", in_quotes(expression),
                                             printable_line(compiled->error())));
}

bool BytePattern::in(ByteView bytes) const { return re2::RE2::PartialMatch(as_piece(bytes), *expression_); }

}  // namespace porttape
