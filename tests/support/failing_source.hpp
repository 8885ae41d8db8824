#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "libport/tape/byte_source.hpp"

namespace porttape::test {

// Bytes whose reads fail after so many of them; below 0: never.
class FailingSource final : public ByteSource {
 public:
  FailingSource(Bytes bytes, int reads_left) : bytes_("bytes", std::move(bytes)), reads_left_(reads_left) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    if (reads_left_-- == 0) return make_error(Errc::io, "out of order");
    return bytes_.read_at(offset, into);
  }
  Result<std::uint64_t> size() override { return bytes_.size(); }
  [[nodiscard]] const std::string& name() const override { return bytes_.name(); }

 private:
  porttape::MemorySource bytes_;
  int reads_left_;
};

}  // namespace porttape::test
