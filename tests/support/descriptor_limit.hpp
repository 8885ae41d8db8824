// Descriptors that run out, for tests of what happens then.

#pragma once

#include <cstddef>
#include <sys/resource.h>
#include <unistd.h>
#include <vector>

#include "libport/base/unique_fd.hpp"

// The sanitizers open a pipe to find out whether memory can be read, and take a refusal for bad memory. A
// test that leaves porttape without descriptors while its objects are used therefore begins with this.
#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define PORTTAPE_IS_SANITIZED 1  // clang
#endif
#elif defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PORTTAPE_IS_SANITIZED 1  // g++
#endif
#ifdef PORTTAPE_IS_SANITIZED
#define PORTTAPE_SKIP_UNDER_SANITIZERS() GTEST_SKIP() << "the sanitizers need descriptors themselves"
#else
#define PORTTAPE_SKIP_UNDER_SANITIZERS() static_cast<void>(0)
#endif

namespace porttape::test {

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
  NoDescriptors() : DescriptorLimit(3) {}
};

// While it lives, this process gets `left` new descriptors, and no more.
class FewDescriptors {
 public:
  explicit FewDescriptors(std::size_t left) : limit_(256) {
    for (int fd = ::dup(0); fd >= 0; fd = ::dup(0)) taken_.emplace_back(fd);
    taken_.resize(taken_.size() - left);
  }

 private:
  DescriptorLimit limit_;
  std::vector<UniqueFd> taken_;
};

}  // namespace porttape::test
