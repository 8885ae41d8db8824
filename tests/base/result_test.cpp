#include "libport/base/result.hpp"

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <gtest/gtest.h>

namespace porttape {
namespace {

Result<int> half(int number) {
  if (number % 2 != 0) return make_error(Errc::usage, std::to_string(number) + " is odd");
  return number / 2;
}

TEST(Result, HoldsAValueOrAnError) {
  const Result<int> good = half(4);
  ASSERT_TRUE(good);
  EXPECT_EQ(*good, 2);
  EXPECT_EQ(good.error(), Error());
  const Result<int> bad = half(3);
  ASSERT_FALSE(bad.has_value());
  EXPECT_EQ(bad.error(), (Error{Errc::usage, "3 is odd"}));
}

TEST(Result, AccessToWhatIsNotThereThrowsTheError) {
  Result<std::string> bad = make_error(Errc::io, "the disk is full");
  EXPECT_THROW((void)*bad, UncheckedError);
  EXPECT_THROW((void)bad->size(), UncheckedError);
  try {
    (void)bad.value();
    FAIL() << "nothing was thrown";
  } catch (const UncheckedError& error) {
    EXPECT_EQ(std::string_view(error.what()), "the disk is full");
  }
}

TEST(Result, TakesWhatConvertsToItsValue) {
  const Result<std::string> text = "a word";
  EXPECT_EQ(*text, "a word");
  const Result<std::optional<std::string>> maybe = std::string("another");
  EXPECT_EQ(*maybe, "another");
  const Result<long> wider = half(8);
  EXPECT_EQ(*wider, 4);
  const Result<long> failed = half(1);
  EXPECT_EQ(failed.error().message, "1 is odd");
}

TEST(Result, MovesWhatCannotBeCopied) {
  Result<std::unique_ptr<int>> owner = std::make_unique<int>(7);
  const std::unique_ptr<int> taken = *std::move(owner);
  EXPECT_EQ(*taken, 7);
}

TEST(Result, OfVoidIsDoneOrAnError) {
  const Result<void> done;
  EXPECT_TRUE(done);
  EXPECT_EQ(done.error(), Error());
  const Result<void> bad = half(5).error();
  EXPECT_FALSE(bad);
  EXPECT_THROW(bad.value(), UncheckedError);
  EXPECT_EQ(bad.error().message, "5 is odd");
  EXPECT_NE(done, bad);
}

}  // namespace
}  // namespace porttape
