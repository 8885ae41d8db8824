#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "libport/replay/answer_source.hpp"
#include "libport/replay/tape_part.hpp"
#include "libport/tape/block_file.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// The r file of a tape, read from any block on; times as the part that is played counts them.
class TapeAnswers final : public AnswerSource {
 public:
  // A tape without an r file has no answers. Errors: Errc::usage, Errc::not_a_tape.
  static Result<std::unique_ptr<TapeAnswers>> open(const TapePaths& tape, const TapePart& part);

  Result<void> seek(std::uint64_t file_offset, std::uint64_t reads) override;
  Result<std::optional<Record>> next() override;

 private:
  TapeAnswers(std::optional<BlockFile> file, const TapePart& part) : file_(std::move(file)), part_(part) {}

  std::optional<BlockFile> file_;
  TapePart part_;
};

}  // namespace porttape
