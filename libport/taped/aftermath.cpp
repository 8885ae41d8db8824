#include "libport/taped/aftermath.hpp"

#include <algorithm>
#include <atomic>
#include <utility>

#include "libport/replay/diagnosis.hpp"

namespace porttape {

// On another thread, which it asks to end early.
struct Aftermath::Search {
  std::atomic<bool> stop{false};
};

Aftermath::Aftermath(const PortContext& context, Tape tape, RunReport report, Calls calls)
    : context_(context),
      tape_(std::move(tape)),
      report_(std::move(report)),
      calls_(std::move(calls)),
      limit_(context_.loop->now() + kLimit),
      timer_(*context.loop, [this] { on_quiet(); }) {
  Mismatch& mismatch = *report_->mismatch;
  if (mismatch.came.empty()) mismatch.came = mismatch.got;
  wait(kQuiet);
}

Aftermath::~Aftermath() {
  if (search_) search_->stop = true;
}

void Aftermath::wait(Nanos time) { timer_.set(std::min(context_.loop->now() + time, limit_)); }

void Aftermath::write(ByteView data) {
  if (!report_) return;
  Bytes& came = report_->mismatch->came;
  const ByteView more = data.first(std::min(data.size(), Mismatch::kMostCame - came.size()));
  came.insert(came.end(), more.begin(), more.end());
  if (came.size() == Mismatch::kMostCame) return finish();
  if (!search_) wait(kQuiet);
}

void Aftermath::on_quiet() {
  if (looked_ || context_.loop->now() >= limit_) return finish();
  look_for_answer();
}

// What came before anything was answered is what came there.
void Aftermath::take_got() {
  Mismatch& mismatch = *report_->mismatch;
  const std::size_t shown = std::min(mismatch.came.size(), Mismatch::kMostShown);
  mismatch.got.assign(mismatch.came.begin(), mismatch.came.begin() + static_cast<std::ptrdiff_t>(shown));
}

void Aftermath::look_for_answer() {
  looked_ = true;
  take_got();
  search_ = std::make_shared<Search>();
  const auto found = std::make_shared<std::optional<Bytes>>();
  const auto work = [search = search_, found, tape = tape_, report = *report_] {
    const auto played = PlayedTape::open(tape.paths, tape.as);
    if (!played) return;
    const auto excerpt = read_excerpt(**played, report.mismatch->tape_offset, kFrameGap,
                                      [&search] { return search->stop.load(); });
    if (excerpt) *found = answer_elsewhere(*excerpt, came_from_frame(report, *excerpt));
  };
  const auto told = [this, alive = std::weak_ptr<int>(alive_), found] {
    if (alive.expired() || !report_) return;
    search_.reset();
    *found ? answer(**found) : finish();
  };
  wait(kLimit);
  if (!context_.loop->run_elsewhere(strand_, work, told)) finish();
}

void Aftermath::answer(const Bytes& bytes) {
  report_->mismatch->answered = true;
  calls_.deliver(bytes);
  if (report_) wait(kAfterAnswer);
}

void Aftermath::finish() {
  if (!report_) return;
  if (search_) search_->stop = true;
  if (!looked_) take_got();
  timer_.cancel();
  RunReport report = std::move(*report_);
  report_.reset();
  calls_.done(std::move(report));
}

}  // namespace porttape
