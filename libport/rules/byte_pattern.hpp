#pragma once

#include <memory>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"

namespace re2 {
class RE2;
}

namespace porttape {

// An expression (RE2, as of a rules file's `when`) that is looked for in bytes.
class BytePattern {
 public:
  // Errc::usage: it is none; why.
  static Result<BytePattern> compile(const std::string& expression);

  [[nodiscard]] bool in(ByteView bytes) const;

 private:
  explicit BytePattern(std::shared_ptr<const re2::RE2> expression) : expression_(std::move(expression)) {}
  std::shared_ptr<const re2::RE2> expression_;
};

}  // namespace porttape
