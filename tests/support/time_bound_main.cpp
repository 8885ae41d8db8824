// The main function of the unit tests: GoogleMock's, except for the exit status of a run in which only bounds
// of time failed.

#include <atomic>
#include <memory>
#include <string_view>

#include <gmock/gmock.h>

#include "tests/support/time_bound.hpp"

namespace {

// Counts the failed assertions of each kind. Assertions may fail in any thread.
class CountFailures : public testing::EmptyTestEventListener {
 public:
  bool only_bounds_of_time() const { return bounds_ > 0 && others_ == 0; }

 private:
  void OnTestPartResult(const testing::TestPartResult& result) override {
    if (result.failed()) {
      ++(std::string_view(result.message()).starts_with(porttape::test::kBoundOfTimeMark) ? bounds_
                                                                                          : others_);
    }
  }

  std::atomic<int> bounds_ = 0;
  std::atomic<int> others_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  auto owned = std::make_unique<CountFailures>();
  const CountFailures& failures = *owned;
  testing::UnitTest::GetInstance()->listeners().Append(owned.release());
  const int status = RUN_ALL_TESTS();
  return status != 0 && failures.only_bounds_of_time() ? porttape::test::kBoundOfTime : status;
}
