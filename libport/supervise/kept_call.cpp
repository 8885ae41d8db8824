#include "libport/supervise/kept_call.hpp"

namespace porttape {

void KeptCall::finish(Outcome outcome) {
  if (const auto finish = std::exchange(finish_, {})) finish(std::move(outcome));
}

void KeptCall::call_at(Instant when, std::function<void()> callback) {
  if (over()) return;
  callback_ = std::move(callback);
  moment_(when);
}

}  // namespace porttape
