#pragma once

#include "libport/tape/tape_sink.hpp"

namespace porttape::test {

// A disk that takes everything at once and keeps nothing. A subclass says what else comes of an append.
class TakingSink : public TapeSink {
 public:
  Appended append(ByteView head, ByteView body) override { return {head.size() + body.size(), 0}; }
  int truncate(std::uint64_t) override { return 0; }
  Sync syncer() override {
    return [] { return 0; };
  }
  int close() override { return 0; }
};

}  // namespace porttape::test
