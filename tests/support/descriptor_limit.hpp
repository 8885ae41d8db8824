// Descriptors that run out, for tests of what happens then.

#pragma once

#include <cstddef>
#include <sys/resource.h>
#include <unistd.h>
#include <vector>

#include "libport/base/unique_fd.hpp"

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define PORTTAPE_IS_SANITIZED 1  // clang
#endif
#elif defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PORTTAPE_IS_SANITIZED 1  // g++
#endif
#ifndef PORTTAPE_IS_SANITIZED
#define PORTTAPE_IS_SANITIZED 0
#endif

// Skips the test in a sanitized build. In each other build it makes `unsanitized`, which NoDescriptors and
// FewDescriptors ask for.
#define PORTTAPE_SKIP_UNDER_SANITIZERS()                            \
  [[maybe_unused]] const porttape::test::Unsanitized unsanitized{}; \
  if (PORTTAPE_IS_SANITIZED) GTEST_SKIP() << "the sanitizers need descriptors themselves"

namespace porttape::test {

// Says that the test does not run in a sanitized build: PORTTAPE_SKIP_UNDER_SANITIZERS() makes it. The
// sanitizers open a pipe to find out whether memory can be read, and take a refusal for bad memory, so that a
// sanitized test without descriptors fails wherever it uses an object of porttape's.
struct Unsanitized {};

// While it lives, this process gets no new descriptor whose number is `limit` or more. Those it has stay
// open.
class DescriptorLimit {
 public:
  explicit DescriptorLimit(rlim_t limit) {
    ::getrlimit(RLIMIT_NOFILE, &before_);
    const rlimit now{limit, before_.rlim_max};
    ::setrlimit(RLIMIT_NOFILE, &now);
  }
  ~DescriptorLimit() { ::setrlimit(RLIMIT_NOFILE, &before_); }
  DescriptorLimit(const DescriptorLimit&) = delete;
  DescriptorLimit& operator=(const DescriptorLimit&) = delete;

 private:
  rlimit before_{};
};

// While it lives, this process gets no new descriptor, whichever it closes: standard input, output and error
// are open.
class NoDescriptors : public DescriptorLimit {
 public:
  explicit NoDescriptors(Unsanitized /*unused*/) : DescriptorLimit(3) {}
};

// While it lives, this process gets `left` new descriptors, and no more.
class FewDescriptors {
 public:
  FewDescriptors(Unsanitized /*unused*/, std::size_t left) : limit_(256) {
    for (int fd = ::dup(0); fd >= 0; fd = ::dup(0)) taken_.emplace_back(fd);
    taken_.resize(taken_.size() - left);
  }

 private:
  DescriptorLimit limit_;
  std::vector<UniqueFd> taken_;
};

}  // namespace porttape::test
