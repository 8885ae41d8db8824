#define CATCH_CONFIG_MAIN
#include "ask.hpp"

#include <catch2/catch.hpp>
#include <libport/testing/tape_device.hpp>

TEST_CASE("green") {
  porttape::TapeDevice device("tapes/ask");
  CHECK(ask(device.port(), "ask\n") == "42\n");
  INFO(device.verdict());
  CHECK(device.verdict());
}

TEST_CASE("red") {
  porttape::TapeDevice device("tapes/ask");
  ask(device.port(), "axk\n");
  INFO(device.verdict());
  CHECK(device.verdict());
}
