#include "libport/loop/path_watch.hpp"

#include <algorithm>
#include <deque>
#include <filesystem>
#include <utility>

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;  // as the kernel

// What is still to be looked up, behind the names of `path`.
void put_before(std::deque<std::string>& names, const fs::path& path) {
  const fs::path relative = path.relative_path();
  const std::deque<std::string> added(relative.begin(), relative.end());
  names.insert(names.begin(), added.begin(), added.end());
}

}  // namespace

PathWatch::PathWatch(Loop& loop, const std::string& path, std::function<void()> on_change, Nanos first)
    : loop_(&loop),
      path_(fs::absolute(path).string()),
      on_change_(std::move(on_change)),
      timer_(loop, [this] { look(); }),
      wait_(first, kLongest) {
  walk();
  watch_again();
}

// Each folder is watched before a name is looked up in it: what comes later is told.
void PathWatch::walk() {
  Watches watches;
  leads_ = follow(watches);
  watches_ = std::move(watches);
}

// The way as the kernel goes it.
bool PathWatch::follow(Watches& watches) {
  std::deque<std::string> names;
  put_before(names, path_);
  fs::path folder = "/";
  for (int links = 0; !names.empty();) {
    const std::string name = names.front();
    names.pop_front();
    if (name.empty() || name == ".") continue;
    if (name == "..") {
      folder = folder.parent_path();
      continue;
    }
    watches.push_back(loop_->file_events().watch_folder(folder.string(), name));
    watches.back()->on_event([this] { on_event(); });
    std::error_code error;
    const fs::path here = folder / name;
    const fs::file_status status = fs::symlink_status(here, error);
    if (error || !fs::exists(status)) return false;
    if (!fs::is_symlink(status)) {
      folder = here;
      continue;
    }
    const fs::path target = fs::read_symlink(here, error);
    if (error || ++links > kMostLinks) return false;
    if (target.is_absolute()) folder = "/";
    put_before(names, target);
  }
  return true;
}

void PathWatch::watch_again() {
  const bool unwatched =
      std::ranges::any_of(watches_, [](const auto& watch) { return !watch->is_watching(); });
  if (leads_ || unwatched) {
    timer_.set_after(wait_.next());
  } else {
    timer_.cancel();
  }
}

void PathWatch::on_event() {
  wait_.reset();
  look();
}

void PathWatch::look() {
  walk();
  watch_again();
  if (!leads_) return;
  const std::function<void()> call = on_change_;  // which may destroy this
  call();
}

}  // namespace porttape
