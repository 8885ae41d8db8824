#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

#include "libport/base/bytes.hpp"
#include "libport/port/port.hpp"

namespace porttape::simulation {

// One thing that happens on a line: bytes, or an act of one of its ends that has its place among them.
struct Passed {
  enum class What : std::uint8_t {
    data,
    signal,
    settings,
    flush,
    drain,
    ask,
    // Only in the log of a port, see Line::passed.
    peer_set,  // line::Settings of the driver; a device's port is told what `settings` it is to take by
               // apply()
    drained,   // what `drain` of this number asked for is done
    answered,
    prepare,
    finish,
    open,
    up,
    interrupted,
    resumed,
    ended,  // the far end sends no more, and the listener was told
    end_writing,
    down,
    close
  };
  bool to_listener = false;
  Bytes data = {};
  What what = What::data;
  LineSignal signal = {};
  SeenSettings settings = {};
  SettingsOrder order = SettingsOrder::exact;
  FlushQueue queue = FlushQueue::in;
  std::uint64_t number = 0;  // of a drain or a question: its own in this world
  LineRequest request = {};
  LineDown::Reason reason = LineDown::Reason::closed;  // of down
  bool over = false;                                   // of drained and answered: the line's end did it
  Instant at = {};
  std::uint64_t serial = 0;  // counts what all ports of the world log
};

// Bytes and acts on their way to one end of a line, in order.
class LineQueue {
 public:
  // `whole`: what is put in is a datagram, and is taken or dropped as one.
  explicit LineQueue(bool whole = false) : whole_(whole) {}
  void clear() { *this = LineQueue(whole_); }
  [[nodiscard]] bool empty() const { return items_.empty(); }
  [[nodiscard]] std::size_t bytes() const { return bytes_; }
  // The first act, where no byte is before it.
  [[nodiscard]] bool act_is_first() const {
    return !items_.empty() && items_.front().what != Passed::What::data;
  }
  // The first act anywhere; null: there is none.
  [[nodiscard]] const Passed* first_act() const {
    const auto found = find_act();
    return found == items_.end() ? nullptr : &*found;
  }

  void put(ByteView data) {
    if (data.empty()) return;
    bytes_ += data.size();
    if (whole_ || items_.empty() || items_.back().what != Passed::What::data) items_.emplace_back();
    Bytes& last = items_.back().data;
    last.insert(last.end(), data.begin(), data.end());
  }
  void put(Passed act) { items_.push_back(std::move(act)); }

  // Up to `most` bytes before the next act; none where an act is first.
  Bytes take(std::size_t most) {
    if (items_.empty() || act_is_first()) return {};
    Bytes& first = items_.front().data;
    const std::size_t size = whole_ ? first.size() : std::min(most, first.size() - begin_);
    const auto from = first.begin() + static_cast<std::ptrdiff_t>(begin_);
    Bytes taken(from, from + static_cast<std::ptrdiff_t>(size));
    bytes_ -= size;
    begin_ += size;
    if (begin_ == first.size()) pop();
    return taken;
  }
  // The first act, which overtakes the bytes before it.
  std::optional<Passed> take_act() {
    const auto found = find_act();
    if (found == items_.end()) return std::nullopt;
    Passed act = std::move(*found);
    if (found == items_.begin()) {
      pop();
    } else {
      items_.erase(found);
    }
    return act;
  }

  // Drops the last bytes beyond `most`, and says how many that were. The acts stay.
  std::size_t keep(std::size_t most) {
    if (whole_) return keep_whole(most);
    const std::size_t dropped = bytes_ > most ? bytes_ - most : 0;
    std::size_t left = dropped;
    for (auto item = items_.end(); left > 0 && item != items_.begin();) {
      --item;
      if (item->what != Passed::What::data) continue;
      const std::size_t begin = item == items_.begin() ? begin_ : 0;
      const std::size_t size = std::min(left, item->data.size() - begin);
      item->data.resize(item->data.size() - size);
      left -= size;
      if (item->data.size() != begin) continue;
      if (item == items_.begin()) begin_ = 0;
      item = items_.erase(item);
    }
    bytes_ -= dropped;
    return dropped;
  }

 private:
  using Items = std::deque<Passed>;
  [[nodiscard]] Items::const_iterator find_act() const {
    return std::ranges::find_if(items_, [](const Passed& each) { return each.what != Passed::What::data; });
  }
  Items::iterator find_act() {
    return std::ranges::find_if(items_, [](const Passed& each) { return each.what != Passed::What::data; });
  }
  std::size_t keep_whole(std::size_t most) {
    std::size_t dropped = 0;
    while (bytes_ > most) {
      dropped += items_.back().data.size();
      bytes_ -= items_.back().data.size();
      items_.pop_back();
    }
    return dropped;
  }
  void pop() {
    items_.pop_front();
    begin_ = 0;
  }

  bool whole_;
  Items items_;
  std::size_t begin_ = 0;  // of what is left of the first item's bytes
  std::size_t bytes_ = 0;
};

}  // namespace porttape::simulation
