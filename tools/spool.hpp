#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A text of any length that is needed once it is whole: on the disk beyond a megabyte. Owns its file, which
// has no name.
class Spool {
 public:
  Spool() = default;
  Spool(const Spool&) = delete;
  Spool& operator=(const Spool&) = delete;
  ~Spool();

  void add(std::string_view text);
  // All of it, until this object ends; nothing may be added after it. Errc::io: the disk is full, …
  Result<std::string_view> text();

 private:
  void flush();

  std::string kept_;
  UniqueFd file_;
  std::size_t written_ = 0;
  int error_ = 0;
  void* mapped_ = nullptr;
};

}  // namespace porttape
