#include "libport/rules/redact_stream.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>

#include "libport/base/printable.hpp"
#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

constexpr std::size_t kWorkEvery = std::size_t{32} * 1024;  // bytes
constexpr std::size_t kSlice = std::size_t{16} * 1024;      // are searched at once, at least
// A match is seen so far, whatever its rule asks for: as much as any rule may, and a byte.
constexpr std::size_t kMostMatch = 65537;
constexpr std::uint64_t kRangePart = 4096;  // of a range, filled by itself
constexpr std::uint16_t kOwnerFollows = std::numeric_limits<std::uint16_t>::max();

}  // namespace

RedactStream::RedactStream(const RedactBook& book, Of of)
    : book_(book), of_(of), searched_(book.rules().size(), 0) {}

bool RedactStream::concerns(const RedactRule& rule) const {
  const bool anywhere = rule.kind == RedactRule::Kind::pattern || rule.kind == RedactRule::Kind::text;
  if (of_ == Of::text) return anywhere && rule.events;
  return !rule.direction || *rule.direction == (of_ == Of::reads ? Direction::read : Direction::write);
}

Result<void> RedactStream::add(ByteView bytes) {
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  out_.insert(out_.end(), bytes.begin(), bytes.end());
  owner_.resize(bytes_.size());
  return bytes_.size() - worked_ < kWorkEvery ? Result<void>() : work(false, false);
}

Result<void> RedactStream::pause() {
  cut_frames(true);
  return {};
}

Result<void> RedactStream::finish() { return work(true, true); }

Result<void> RedactStream::work(bool frame_ended, bool all_ended) {
  cut_frames(frame_ended);
  for (std::size_t rule = 0; rule < searched_.size(); ++rule) {
    const RedactRule& asked = book_.rules()[rule];
    if (!concerns(asked) || asked.kind == RedactRule::Kind::place) {
      searched_[rule] = bytes_.size();
    } else if (asked.kind == RedactRule::Kind::range) {
      search_range(rule, all_ended);
    } else if (Result<void> done = search(rule, all_ended); !done) {
      return done;
    }
  }
  settle();
  worked_ = bytes_.size();
  return {};
}

void RedactStream::cut_frames(bool ended) {
  const auto& formats = book_.frames().set().frames;
  if (formats.empty() || of_ == Of::text) framed_ = bytes_.size();
  FrameCutter cutter(formats);
  while (framed_ < bytes_.size()) {
    const ByteView rest = ByteView(bytes_).subspan(framed_);
    const FrameCut cut = cutter.cut(bytes_, framed_, ended);
    if (cut.state == FrameCut::State::more) return;
    if (cut.state == FrameCut::State::frame) {
      const Frame frame{framed_, framed_ + cut.size, cut.format};
      frames_.push_back(frame);
      for (std::size_t rule = 0; rule < searched_.size(); ++rule) {
        const RedactRule& asked = book_.rules()[rule];
        if (asked.kind != RedactRule::Kind::place || !concerns(asked)) continue;
        if (const auto secret = book_.secret_in(rule, cut.format, rest.first(cut.size)))
          replace(rule, {framed_ + secret->begin, framed_ + secret->end});
      }
    }
    framed_ += cut.size;
  }
}

// A match is what the expression finds in the whole stream, as far as kMostMatch. A slice is searched once
// all of it is there, so that it does not matter how the stream comes, and a byte more, so that an end of the
// text is the stream's.
Result<void> RedactStream::search(std::size_t rule, bool ended) {
  const bool is_text = book_.rules()[rule].kind == RedactRule::Kind::text;
  const std::size_t longest = book_.longest(rule);
  const std::size_t seen = is_text ? longest : std::max(longest, kMostMatch);
  const std::size_t width = std::max(kSlice, 2 * seen);
  const std::size_t there = ended || bytes_.empty() ? bytes_.size() : bytes_.size() - 1;
  const std::size_t judged = ended ? bytes_.size() : there + 1 - std::min(there + 1, width);
  std::size_t& at = searched_[rule];
  while (at < judged) {
    const std::size_t slice = std::min(there, at + width);
    const bool to_end = ended && slice == bytes_.size();
    const std::size_t sure = to_end ? slice : slice + 1 - seen;
    auto match = book_.find(rule, bytes_, at, slice, false);
    if (!match || match->begin >= sure) {
      at = sure;
      continue;
    }
    const std::size_t begin = match->begin;
    match = book_.find(rule, bytes_, begin, std::min(begin + seen, there), true);
    if (match && match->end == begin) {
      at = begin + 1;
      continue;
    }
    if (!match || match->end - begin >= longest) {
      const RedactRule& asked = book_.rules()[rule];
      return make_error(Errc::usage,
                        fmt::format("[[redact]] {} (line {}): a match at byte {} may go on beyond {} bytes; "
                                    "give it a larger 'longest', or a narrower pattern",
                                    asked.name.in_quotes(), asked.line.number, base_ + begin, longest - 1));
    }
    replace(rule, match->secret);
    at = match->end;
  }
  return {};
}

void RedactStream::search_range(std::size_t rule, bool ended) {
  const RedactRule& asked = book_.rules()[rule];
  const auto begin = static_cast<std::uint64_t>(asked.offset);
  const std::uint64_t end = begin + static_cast<std::uint64_t>(asked.size);
  std::size_t& at = searched_[rule];
  while (at < bytes_.size()) {
    const std::uint64_t place = base_ + at;
    const std::uint64_t behind = base_ + bytes_.size();
    if (place >= end || behind <= begin) {
      at = bytes_.size();
    } else if (place < begin) {
      at = static_cast<std::size_t>(begin - base_);
    } else {
      const std::uint64_t part = std::min(end, begin + ((place - begin) / kRangePart + 1) * kRangePart);
      if (part > behind && !ended) return;
      const auto to = static_cast<std::size_t>(std::min(part, behind) - base_);
      replace(rule, {at, to});
      at = to;
    }
  }
}

void RedactStream::replace(std::size_t rule, FrameSpan secret) {
  if (secret.size() == 0) return;
  const Bytes filler = book_.filler().fill(book_.rules()[rule], secret.of(bytes_), of_ == Of::text);
  const auto mine = static_cast<std::uint16_t>(rule + 1);
  for (std::size_t i = secret.begin; i < secret.end; ++i) {
    if (owner_[i] != 0 && owner_[i] < mine) continue;
    owner_[i] = mine;
    out_[i] = filler[i - secret.begin];
  }
  found_.push_back({base_ + secret.begin, secret.size(), static_cast<int>(rule)});
}

void RedactStream::mend(const Frame& frame) {
  const auto begin = owner_.begin() + static_cast<std::ptrdiff_t>(frame.begin);
  const auto end = owner_.begin() + static_cast<std::ptrdiff_t>(frame.end);
  if (std::all_of(begin, end, [](std::uint16_t owner) { return owner == 0; })) return;
  const ByteView before = ByteView(bytes_).subspan(frame.begin, frame.end - frame.begin);
  if (book_.frames().checksum_holds(frame.format, before) == false) ++wrong_checksums_;
  const ByteView filled = ByteView(out_).subspan(frame.begin, before.size());
  Bytes mended(filled.begin(), filled.end());
  book_.frames().mend(frame.format, before, mended);
  for (std::size_t i = 0; i < mended.size();) {
    std::size_t same = i;
    while (same < mended.size() && mended[same] != filled[same]) ++same;
    if (same > i) found_.push_back({base_ + frame.begin + i, same - i, Redaction::kFollows});
    for (std::size_t k = i; k < same; ++k) owner_[frame.begin + k] = kOwnerFollows;
    i = std::max(same, i + 1);
  }
  std::copy(mended.begin(), mended.end(), out_.begin() + static_cast<std::ptrdiff_t>(frame.begin));
}

void RedactStream::settle() {
  settled_ = framed_;
  for (const std::size_t searched : searched_) settled_ = std::min(settled_, searched);
  while (!frames_.empty() && frames_.front().end <= settled_) {
    mend(frames_.front());
    frames_.pop_front();
  }
  if (!frames_.empty()) settled_ = std::min(settled_, frames_.front().begin);
}

RedactStream::Ready RedactStream::take() {
  Ready ready;
  if (settled_ <= taken_) return ready;
  ready.bytes.assign(out_.begin() + static_cast<std::ptrdiff_t>(taken_),
                     out_.begin() + static_cast<std::ptrdiff_t>(settled_));
  const std::uint64_t end = base_ + settled_;
  const auto later = std::stable_partition(found_.begin(), found_.end(),
                                           [&](const Redaction& each) { return each.offset < end; });
  ready.redactions.assign(found_.begin(), later);
  found_.erase(found_.begin(), later);
  std::stable_sort(ready.redactions.begin(), ready.redactions.end(),
                   [](const Redaction& one, const Redaction& other) { return one.offset < other.offset; });
  taken_ = settled_;
  forget();
  return ready;
}

// All but the last byte of what was taken: expressions look at what stands before.
void RedactStream::forget() {
  if (taken_ < 2) return;
  const std::size_t count = taken_ - 1;
  const auto drop = [count](auto& list) {
    list.erase(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(count));
  };
  drop(bytes_);
  drop(out_);
  drop(owner_);
  base_ += count;
  for (std::size_t* const place : {&worked_, &framed_, &settled_, &taken_}) *place -= count;
  for (std::size_t& searched : searched_) searched -= count;
  for (Frame& frame : frames_) {
    frame.begin -= count;
    frame.end -= count;
  }
}

}  // namespace porttape
