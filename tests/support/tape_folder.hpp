#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tape/tape_name.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape::test {

// A folder with the files of tapes, whose content is any text.
class TapeFolder : public testing::Test {
 protected:
  // Of all that is there, sorted.
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& each : std::filesystem::directory_iterator(dir.path()))
      all.push_back(each.path().filename().string());
    std::ranges::sort(all);
    return all;
  }
  static std::string content_of(const std::filesystem::path& path) {
    const Bytes bytes = read_file(path);
    return std::string(as_text(bytes));
  }
  // The same text in each of a tape's files.
  static void write_all(const TapePaths& tape, const std::string& text) {
    for (const auto& path : {tape.read, tape.write, tape.events}) write_file(path, bytes_of(text));
  }
  static void expect_all(const TapePaths& tape, const std::string& text) {
    for (const auto& path : {tape.read, tape.write, tape.events}) EXPECT_EQ(content_of(path), text) << path;
  }

  TempDir dir;
};

}  // namespace porttape::test
