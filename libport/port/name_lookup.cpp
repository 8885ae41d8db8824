#include "libport/port/name_lookup.hpp"

#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>

namespace porttape {

using Work = boost::asio::executor_work_guard<boost::asio::io_context::executor_type>;

struct NameLookup::State {
  std::mutex mutex;          // guards loop and work
  Loop* loop = nullptr;      // null once nobody waits
  std::optional<Work> work;  // the loop has something to wait for
  Callback callback;         // touched by the loop's thread alone
};

NameLookup::NameLookup(Loop& loop, const std::string& host, std::uint16_t port, Callback callback)
    : state_(std::make_shared<State>()) {
  state_->loop = &loop;
  state_->work.emplace(loop.io().get_executor());
  state_->callback = std::move(callback);
  const auto answer = [](const std::shared_ptr<State>& state, Result<std::vector<SocketAddress>> result) {
    const std::lock_guard lock(state->mutex);
    if (state->loop == nullptr) return;
    state->loop->post([state, result = std::move(result)] {
      if (const Callback call = std::exchange(state->callback, {})) call(result);
    });
    state->work.reset();
  };
  try {
    std::thread([state = state_, host, port, answer] { answer(state, resolve(host, port)); }).detach();
  } catch (const std::system_error& error) {
    answer(state_, make_error(Errc::io, std::string("no thread for a name lookup: ") + error.what()));
  }
}

NameLookup::~NameLookup() {
  state_->callback = {};
  const std::lock_guard lock(state_->mutex);
  state_->loop = nullptr;
  state_->work.reset();
}

}  // namespace porttape
