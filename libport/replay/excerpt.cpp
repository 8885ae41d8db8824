#include "libport/replay/excerpt.hpp"

#include <algorithm>
#include <deque>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kMostRequest = 65536;  // of one exchange, before it is cut into frames anyway

std::vector<std::size_t> line_ends(ByteView request) {
  std::vector<std::size_t> ends;
  for (std::size_t i = 1; i <= request.size(); ++i) {
    const bool last = i == request.size();
    if (last || (is_line_end(request[i - 1]) && !is_line_end(request[i]))) ends.push_back(i);
  }
  return ends;
}

// Collects the steps of a tape in order and keeps those around the offset.
class Excerpts {
 public:
  Excerpts(std::uint64_t offset, Micros burst_gap, const FrameEnds& frame_ends)
      : offset_(offset), burst_gap_(burst_gap), frame_ends_(frame_ends) {}

  // False: nothing more is wanted.
  bool take(const Record& record) {
    if (record.kind == RecordKind::write && !record.data.empty()) return write(record);
    if (record.kind == RecordKind::read && !record.data.empty()) return read(record);
    return true;
  }

  TapeExcerpt end(bool tape_ended) {
    close_request();
    TapeExcerpt out;
    out.from_start = !dropped_;
    out.to_end = tape_ended && behind_ <= TapeExcerpt::kReach;
    out.lines = lines_;
    out.steps.assign(std::make_move_iterator(steps_.begin()), std::make_move_iterator(steps_.end()));
    const auto place = std::ranges::find_if(out.steps, [this](const TapeExcerpt::Step& step) {
      return step.frame.offset + step.frame.length > offset_;
    });
    out.place = static_cast<std::size_t>(place - out.steps.begin());
    return out;
  }

 private:
  struct Mark {  // where a recorded write begins in the request
    std::size_t at = 0;
    TapeTime time{};
    bool apart = false;  // from the one before
  };

  bool write(const Record& record) {
    if (answered_) {
      answered_ = false;
      ++exchange_;
      part_ = 1;
      first_of_exchange_ = count_;
    }
    if (request_.empty()) request_offset_ = record.stream_offset;
    const bool apart = !marks_.empty() && record.at - marks_.back().time >= burst_gap_;
    marks_.push_back({request_.size(), record.at, apart});
    request_.insert(request_.end(), record.data.begin(), record.data.end());
    if (request_.size() >= kMostRequest) close_request();
    return behind_ < TapeExcerpt::kReach;
  }

  bool read(const Record& record) {
    close_request();
    answered_ = true;
    if (steps_.empty()) return true;
    std::optional<TapeAnswer>& answer = steps_.back().answer;
    if (!answer) answer = TapeAnswer{{}, 0, record.stream_offset, record.at, record.at};
    const std::size_t room = TapeAnswer::kMostBytes - answer->bytes.size();
    const ByteView part = record.data.first(std::min(record.data.size(), room));
    answer->bytes.insert(answer->bytes.end(), part.begin(), part.end());
    answer->length += record.data.size();
    answer->at = record.at;
    return behind_ < TapeExcerpt::kReach;
  }

  [[nodiscard]] std::vector<std::size_t> ends() {
    std::vector<std::size_t> blocks;
    for (const Mark& mark : marks_) {
      if (mark.apart) blocks.push_back(mark.at);
    }
    blocks.push_back(request_.size());
    if (count_ == 0) lines_ = is_line_end(request_.back());
    if (frame_ends_) return frame_ends_(request_, blocks);
    return lines_ && is_line_end(request_.back()) ? line_ends(request_) : blocks;
  }

  void close_request() {
    if (request_.empty()) return;
    std::size_t begin = 0;
    for (const std::size_t end : ends()) {
      if (end <= begin || end > request_.size()) continue;
      add_frame(begin, end);
      begin = end;
    }
    const auto parts = static_cast<std::uint32_t>(count_ - first_of_exchange_);
    const std::size_t kept = std::min<std::size_t>(parts, steps_.size());
    for (std::size_t i = 0; i < kept; ++i) steps_[steps_.size() - 1 - i].frame.parts = parts;
    request_.clear();
    marks_.clear();
  }

  // When the byte at `at` of the request was written.
  [[nodiscard]] TapeTime time_of(std::size_t at) const {
    const auto next = std::ranges::upper_bound(marks_, at, {}, &Mark::at);
    return std::prev(next)->time;
  }

  void add_frame(std::size_t begin, std::size_t end) {
    TapeFrame frame;
    const ByteView bytes = ByteView(request_).subspan(begin, std::min(end - begin, TapeFrame::kMostBytes));
    frame.bytes.assign(bytes.begin(), bytes.end());
    frame.length = end - begin;
    frame.offset = request_offset_ + begin;
    frame.exchange = exchange_;
    frame.part = part_++;
    frame.begun = time_of(begin);
    frame.at = time_of(end - 1);
    if (frame.offset > offset_) ++behind_;
    const bool before = frame.offset + frame.length <= offset_;
    steps_.push_back({std::move(frame), std::nullopt});
    ++count_;
    if (before && steps_.size() > TapeExcerpt::kReach) {
      steps_.pop_front();
      dropped_ = true;
    }
  }

  std::uint64_t offset_;
  Micros burst_gap_;
  const FrameEnds& frame_ends_;
  std::deque<TapeExcerpt::Step> steps_;
  Bytes request_;
  std::vector<Mark> marks_;
  std::uint64_t request_offset_ = 0;
  std::uint64_t exchange_ = 0;
  std::uint32_t part_ = 1;
  std::uint64_t count_ = 0;  // of all frames
  std::uint64_t first_of_exchange_ = 0;
  std::size_t behind_ = 0;  // frames behind the place
  bool answered_ = true;
  bool dropped_ = false;
  bool lines_ = false;
};

}  // namespace

bool TapeFrame::is(ByteView other) const {
  return other.size() == length && bytes.size() == length && std::ranges::equal(bytes, other);
}

std::optional<TapeExcerpt> read_excerpt(RecordSource& tape, std::uint64_t offset, Micros burst_gap,
                                        const GiveUp& give_up, const FrameEnds& frame_ends) {
  if (!tape.rewind()) return std::nullopt;
  Excerpts excerpts(offset, burst_gap, frame_ends);
  for (unsigned looked = 1;; ++looked) {
    if (looked % kRecordsBetweenLooks == 0 && give_up && give_up()) return std::nullopt;
    const auto record = tape.next();
    if (!record) return std::nullopt;
    if (!*record) return excerpts.end(true);
    if (!excerpts.take(**record)) return excerpts.end(false);
  }
}

void begin_at(TapeExcerpt& excerpt, TapeTime start) {
  const auto place = excerpt.steps.begin() + static_cast<std::ptrdiff_t>(excerpt.place);
  const auto first = std::find_if(excerpt.steps.begin(), place,
                                  [start](const auto& step) { return step.frame.begun >= start; });
  excerpt.place = static_cast<std::size_t>(place - first);
  excerpt.steps.erase(excerpt.steps.begin(), first);
}

}  // namespace porttape
