#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/json_object.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/tape/tape_diff.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// Of the files of both tapes together: what a browser holds without trouble.
inline constexpr std::uint64_t kMostViewBytes = std::uint64_t{256} << 20U;

// Writes the page of `porttape view` into a file: the tapes one after the other, what they differ in, and
// end(). Refers to the file.
class ViewWriter {
 public:
  using Progress = std::function<void(std::uint64_t bytes)>;
  ViewWriter(NewFile& file, Progress progress) : file_(file), progress_(std::move(progress)) {}

  Result<void> begin();
  // Of a damaged tape what is sound is on the page, which says so. Errors: as of TapeReader, but damage;
  // Errc::io of the file; Errc::usage: the tapes have grown beyond kMostViewBytes.
  Result<void> add_tape(const TapePaths& paths);
  Result<void> add_differences(const TapePaths& one, const TapePaths& other, const TapeDiff& diff,
                               std::optional<Micros> margin);
  Result<void> end();

  // What is wrong with the tapes.
  [[nodiscard]] const std::vector<Error>& damage() const { return damage_; }

 private:
  NewFile& file_;
  Progress progress_;
  std::uint64_t done_ = 0;  // bytes of the tapes
  JsonList tapes_;
  std::optional<JsonObject> differences_;
  int tape_ = 0;
  std::vector<Error> damage_;
};

}  // namespace porttape
