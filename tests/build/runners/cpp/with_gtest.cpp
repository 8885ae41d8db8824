#include "ask.hpp"

#include <gtest/gtest.h>
#include <libport/testing/tape_device.hpp>

TEST(Ask, Green) {
  porttape::TapeDevice device("tapes/ask");
  EXPECT_EQ(ask(device.port(), "ask\n"), "42\n");
  EXPECT_TRUE(device.verdict()) << device.verdict();
}

TEST(Ask, Red) {
  porttape::TapeDevice device("tapes/ask");
  ask(device.port(), "axk\n");
  EXPECT_TRUE(device.verdict()) << device.verdict();
}
