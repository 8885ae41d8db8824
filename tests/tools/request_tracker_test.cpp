#include "tools/request_tracker.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace porttape {
namespace {

std::vector<TapeParts::Part> parts_of(const std::vector<std::string>& requests) {
  std::vector<TapeParts::Part> parts;
  for (const std::string& request : requests) {
    const ByteView bytes = as_bytes(request);
    parts.push_back({.request = Bytes(bytes.begin(), bytes.end()), .read = 2});
  }
  return parts;
}

class RequestTrackerTest : public testing::Test {
 protected:
  void track(const std::vector<std::string>& requests, bool exact = true) {
    parts = parts_of(requests);
    tracker.emplace(parts, exact);
  }
  void asks(std::string_view text) { tracker->driver_wrote(as_bytes(text)); }
  void gets() { tracker->driver_was_sent(as_bytes("ok")); }
  [[nodiscard]] std::string turns() const {
    std::string text;
    for (const auto& [part, read, written] : tracker->turns())
      text += std::to_string(part) + '/' + std::to_string(read) + '/' + std::to_string(written) + ' ';
    return text;
  }
  std::vector<TapeParts::Part> parts;
  std::optional<RequestTracker> tracker;
};

TEST_F(RequestTrackerTest, ARequestMayComeInPiecesAndAgain) {
  track({"ab", "cd"});
  asks("a");
  asks("b");
  gets();
  asks("ab");
  gets();
  asks("cd");
  EXPECT_EQ(turns(), "0/0/0 0/2/2 1/4/4 ");
  EXPECT_EQ(tracker->reach(), 2U);
  EXPECT_FALSE(tracker->beyond());
}

TEST_F(RequestTrackerTest, WhatTheTapeHasNotIsBeyondIt) {
  track({"ab", "cd"});
  asks("ab");
  gets();
  asks("xy");
  asks("z");
  EXPECT_TRUE(tracker->beyond());
  EXPECT_EQ(as_text(tracker->unknown()), "xy");
  EXPECT_EQ(tracker->reach(), 2U);
  gets();
  asks("cd");
  EXPECT_EQ(tracker->reach(), 3U);
}

TEST_F(RequestTrackerTest, MoreThanThereIsIsBeyondItToo) {
  track({"ab"});
  asks("ab");
  gets();
  asks("ab");
  EXPECT_TRUE(tracker->beyond());
  EXPECT_TRUE(tracker->unknown().empty());
  EXPECT_EQ(tracker->reach(), 2U);
}

TEST_F(RequestTrackerTest, RequestsMayComeTogetherAndSkipSome) {
  track({"ab", "cd", "ef"});
  asks("abef");
  EXPECT_EQ(turns(), "0/0/0 2/0/2 ");
}

TEST_F(RequestTrackerTest, WhatComesUnaskedIsThere) {
  track({"", "", "ab"});
  tracker->driver_was_sent(as_bytes("hi!!"));
  asks("ab");
  EXPECT_EQ(turns(), "0/0/0 1/2/0 2/4/0 ");
}

TEST_F(RequestTrackerTest, RequestsThatVaryAreCounted) {
  track({"ab", "cd"}, false);
  asks("x");
  asks("y");
  gets();
  asks("z");
  gets();
  EXPECT_EQ(turns(), "0/0/0 1/2/2 ");
  EXPECT_FALSE(tracker->beyond());
  asks("w");
  EXPECT_TRUE(tracker->beyond());
}

}  // namespace
}  // namespace porttape
