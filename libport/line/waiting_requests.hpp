#pragma once

#include <map>
#include <optional>
#include <utility>

#include "libport/line/line_event.hpp"

namespace porttape {

// What waits for the answers to the requests that a port has told. `Done` takes the answer. A plain value.
template <class Done>
class WaitingRequests {
 public:
  RequestNumber keep(Done done) {
    waiting_.emplace(++last_, std::move(done));
    return last_;
  }
  // Once; nothing: it is another's, or was answered.
  std::optional<Done> take(RequestNumber number) {
    auto found = waiting_.extract(number);
    return found ? std::optional(std::move(found.mapped())) : std::nullopt;
  }

 private:
  std::map<RequestNumber, Done> waiting_;
  RequestNumber last_ = 0;
};

}  // namespace porttape
