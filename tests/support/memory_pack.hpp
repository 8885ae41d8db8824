#pragma once

#include <map>
#include <string>

#include "libport/pack/pack_archive.hpp"

namespace porttape::test {

// Keeps what a pack gives; counts how it was driven.
class MemoryPackSink final : public PackSink {
 public:
  Result<void> begin_file(const std::string& name, std::uint64_t size) override {
    twice = twice || files.count(name) > 0;
    odd = odd || !is_plain_name(name);
    told += size;
    now = name;
    files[name];
    return {};
  }
  Result<void> write(ByteView bytes) override {
    files[now] += as_text(bytes);
    given += bytes.size();
    return {};
  }
  Result<void> end_file() override { return {}; }

  std::map<std::string, std::string> files;
  std::string now;
  std::uint64_t told = 0;
  std::uint64_t given = 0;
  bool twice = false;
  bool odd = false;
};

}  // namespace porttape::test
