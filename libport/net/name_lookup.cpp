#include "libport/net/name_lookup.hpp"

#include <optional>
#include <utility>

namespace porttape {

// Kept by the job and by what follows it, so that a lookup that was given up finds nobody to call.
struct NameLookup::State {
  Callback callback;                                         // touched by the loop's thread alone
  std::optional<Result<std::vector<SocketAddress>>> result;  // the job's, then the loop's
};

NameLookup::NameLookup(Loop& loop, const std::string& host, std::uint16_t port, Callback callback)
    : state_(std::make_shared<State>()) {
  state_->callback = std::move(callback);
  const auto tell = [state = state_] {
    if (const Callback call = std::exchange(state->callback, {})) call(*state->result);
  };
  const auto look = [state = state_, host, port] { state->result.emplace(resolve(host, port)); };
  // A strand of its own: one name server that hangs holds up no other name.
  if (loop.run_elsewhere(Workers::Strand(), look, tell)) return;
  state_->result.emplace(make_error(Errc::io, "no thread for a name lookup; raise the limit of processes"));
  loop.post(tell);
}

NameLookup::~NameLookup() { state_->callback = {}; }

}  // namespace porttape
