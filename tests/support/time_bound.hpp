#pragma once

#include <chrono>
#include <string>
#include <type_traits>

#include <gtest/gtest.h>

// The helper for bounds of time. An assertion about how long something took is made with it and with nothing
// else: on a busy machine it may fail where the program is right. When all assertions that failed in a run of
// a test program are of this kind, the program ends with kBoundOfTime, and ./check runs the test once more;
// see tests/README.md. Bytes that do not come are lost bytes however long they were waited for: never assert
// them with this.
namespace porttape::test {

constexpr int kBoundOfTime = 75;  // EX_TEMPFAIL
constexpr char kBoundOfTimeMark[] = "bound of time: ";

// A duration in milliseconds, anything else as GoogleTest prints it.
template <typename Value>
std::string printed(const Value& value) {
  if constexpr (requires { std::chrono::duration<double, std::milli>(value); } &&
                !std::is_arithmetic_v<Value>) {
    return testing::PrintToString(std::chrono::duration<double, std::milli>(value).count()) + " ms";
  } else {
    return testing::PrintToString(value);
  }
}

// For EXPECT_WITHIN.
template <typename Time, typename Bound>
testing::AssertionResult within(const char* elapsed_text, const char* bound_text, const Time& elapsed,
                                const Bound& bound) {
  if (elapsed <= bound) {
    return testing::AssertionSuccess();
  }
  return testing::AssertionFailure() << kBoundOfTimeMark << elapsed_text << " is " << printed(elapsed)
                                     << ", over " << bound_text << ", which is " << printed(bound);
}

// For EXPECT_IN_TIME.
inline testing::AssertionResult in_time(const char* text, bool condition) {
  if (condition) {
    return testing::AssertionSuccess();
  }
  return testing::AssertionFailure() << kBoundOfTimeMark << text << " does not hold";
}

}  // namespace porttape::test

// elapsed <= bound, for durations and numbers.
#define EXPECT_WITHIN(elapsed, bound) EXPECT_PRED_FORMAT2(::porttape::test::within, elapsed, bound)
// A condition that only time can break, such as "the loop never stalled".
#define EXPECT_IN_TIME(condition) EXPECT_PRED_FORMAT1(::porttape::test::in_time, condition)
