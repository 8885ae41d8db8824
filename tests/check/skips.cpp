// Not a test of its own: what skipped_test.sh runs to see how GoogleTest skips.

#include <gtest/gtest.h>

TEST(Skips, ForAReason) { GTEST_SKIP() << "no bananas here"; }
