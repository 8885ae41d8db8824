#include "libport/loop/file_events.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <sys/inotify.h>
#include <unistd.h>
#include <utility>

#include "libport/base/result.hpp"

namespace porttape {
namespace {

constexpr int kUnwatched = -1;  // as the kernel tells that it refuses

constexpr std::uint32_t kFileMask = IN_OPEN | IN_CLOSE;
constexpr std::uint32_t kClosesMask = IN_CLOSE;
// IN_ATTRIB: udev gives a new node its permissions after making it.
constexpr std::uint32_t kFolderMask = IN_CREATE | IN_MOVED_TO | IN_DELETE | IN_MOVED_FROM | IN_ATTRIB;
// The kernel watches no more: the folder is gone, or its file system.
constexpr std::uint32_t kFolderGone = IN_IGNORED | IN_UNMOUNT;

}  // namespace

struct FileEvents::Entry {
  FileEvents* owner;  // null once it is gone
  std::string path;
  std::uint32_t mask;
  std::string name = {};    // of a folder's: what is watched there
  int number = kUnwatched;  // the kernel's
  int parent = kUnwatched;  // that of its folder, which keeps it exact
  std::vector<Event> events = {};
  std::function<void()> callback = {};
  std::shared_ptr<Fence> fence = {};  // of the one who watches
  bool gone = false;
};

FileEvents::FileEvents(Loop& loop) : loop_(&loop), poll_timer_(loop, [this] { on_poll(); }) {}
FileEvents::~FileEvents() {
  for (const std::shared_ptr<Entry>& entry : entries_) entry->owner = nullptr;
}

FileEvents::Watch::Watch(std::shared_ptr<Entry> entry) : entry_(std::move(entry)) {}
FileEvents::Watch::~Watch() {
  if (entry_->owner != nullptr) entry_->owner->remove(entry_);
}

void FileEvents::Watch::on_event(std::function<void()> callback) { entry_->callback = std::move(callback); }
bool FileEvents::Watch::exact() const { return entry_->parent != kUnwatched; }
bool FileEvents::Watch::is_watching() const { return entry_->number != kUnwatched; }

std::vector<FileEvents::Event> FileEvents::Watch::take() {
  entry_->owner->gather();
  std::vector<Event> events = std::exchange(entry_->events, {});
  entry_->owner->wake_soon();
  return events;
}

void FileEvents::Watch::unnoticed(const std::function<void()>& visit) {
  entry_->owner->gather();
  std::vector<Event>& events = entry_->events;
  const auto before = static_cast<std::ptrdiff_t>(events.size());
  visit();
  entry_->owner->gather();
  // An open and a close side by side: whichever program's they are, the number of openers is the same.
  const auto own = [](Event a, Event b) { return a == Event::opened && b == Event::closed; };
  const auto found = std::adjacent_find(events.begin() + before, events.end(), own);
  if (found != events.end()) events.erase(found, found + 2);
  entry_->owner->wake_soon();
}

std::unique_ptr<FileEvents::Watch> FileEvents::watch_file(const std::string& path) {
  auto entry = std::make_shared<Entry>(Entry{.owner = this, .path = path, .mask = kFileMask});
  add(entry);
  return std::make_unique<Watch>(std::move(entry));
}

std::unique_ptr<FileEvents::Watch> FileEvents::watch_closes(const std::string& path) {
  auto entry = std::make_shared<Entry>(Entry{.owner = this, .path = path, .mask = kClosesMask});
  add(entry);
  return std::make_unique<Watch>(std::move(entry));
}

std::unique_ptr<FileEvents::Watch> FileEvents::watch_folder(const std::string& path,
                                                            const std::string& name) {
  auto entry = std::make_shared<Entry>(Entry{.owner = this, .path = path, .mask = kFolderMask, .name = name});
  add(entry);
  return std::make_unique<Watch>(std::move(entry));
}

bool FileEvents::start() {
  if (inotify_) return true;
  if (!refused_) inotify_.reset(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC));
  if (!inotify_) return false;
  loop_->within(nullptr, [this] {
    watch_ = std::make_unique<FdWatch>(*loop_, inotify_.get(), [this] {
      gather();
      wake();
    });
  });
  watch_->watch_readable(true);
  return true;
}

void FileEvents::begin_after(Nanos delay) { begins_ = loop_->now() + delay; }

void FileEvents::add(const std::shared_ptr<Entry>& entry) {
  entry->fence = loop_->fence();
  entries_.push_back(entry);
  if (loop_->now() >= begins_) {
    watch(entry);
  } else if (!poll_timer_.due()) {
    poll_timer_.set_after(kQuickPoll);
  }
}

void FileEvents::watch(const std::shared_ptr<Entry>& entry) {
  if (start())
    entry->number = ::inotify_add_watch(inotify_.get(), entry->path.c_str(), entry->mask | IN_MASK_ADD);
  if (entry->number != kUnwatched) {
    by_number_.emplace(entry->number, entry);
    if (entry->mask == kFileMask) watch_parent(*entry);
  } else if (entry->mask != kFolderMask) {
    refused(entry->path, errno);
  }
}

void FileEvents::refused(const std::string& path, int error_number) {
  if (trouble_.empty()) {
    trouble_ = fmt::format(
        "inotify for {}: {}; opens and closes are looked for every {} ms instead, several quick ones may "
        "count as one (sysctl fs.inotify.max_user_instances, fs.inotify.max_user_watches)",
        path, errno_text(error_number), std::chrono::duration_cast<std::chrono::milliseconds>(kPoll).count());
  }
  if (!poll_timer_.due()) poll_timer_.set_after(kPoll);
}

std::string FileEvents::take_trouble() {
  return trouble_.empty() || std::exchange(trouble_told_, true) ? std::string() : trouble_;
}

void FileEvents::watch_parent(Entry& entry) {
  const std::string folder = std::filesystem::path(entry.path).parent_path().string();
  entry.parent = ::inotify_add_watch(inotify_.get(), folder.c_str(), kFileMask | IN_MASK_ADD | IN_ONLYDIR);
  if (entry.parent != kUnwatched) ++parents_[entry.parent];
}

void FileEvents::remove(const std::shared_ptr<Entry>& entry) {
  entry->gone = true;
  std::erase(entries_, entry);
  if (entries_.empty()) {
    watch_.reset();
    inotify_.reset();
    poll_timer_.cancel();
    by_number_.clear();
    parents_.clear();
    return;
  }
  std::erase_if(by_number_, [&entry](const auto& known) { return known.second == entry; });
  if (entry->parent != kUnwatched && --parents_[entry->parent] == 0) parents_.erase(entry->parent);
  for (const int number : {entry->number, entry->parent}) {
    if (number != kUnwatched && !by_number_.contains(number) && !parents_.contains(number))
      (void)::inotify_rm_watch(inotify_.get(), number);  // may be gone with its file
  }
}

// Takes what the kernel has; nobody is called.
void FileEvents::gather() {
  if (!inotify_) return;
  alignas(inotify_event) std::array<char, 4096> buffer;
  ssize_t size = 0;
  while ((size = ::read(inotify_.get(), buffer.data(), buffer.size())) > 0 || (size < 0 && errno == EINTR)) {
    if (size < 0) continue;
    for (std::size_t at = 0; at < static_cast<std::size_t>(size);) {
      inotify_event event{};
      std::memcpy(&event, buffer.data() + at, sizeof event);
      const char* const name = buffer.data() + at + sizeof event;  // padded with zeros
      distribute(event.wd, event.mask, {name, ::strnlen(name, event.len)});
      at += sizeof event + event.len;
    }
    // One that is not nearly full has left nothing behind.
    if (static_cast<std::size_t>(size) < buffer.size() / 2) break;
  }
}

void FileEvents::distribute(int wd, std::uint32_t mask, std::string_view name) {
  if ((mask & IN_Q_OVERFLOW) != 0) {
    lose();
    return;
  }
  const auto [begin, end] = by_number_.equal_range(wd);
  for (auto known = begin; known != end; ++known) {
    const Entry& entry = *known->second;
    const std::uint32_t wanted = mask & entry.mask;
    if ((wanted & IN_OPEN) != 0) pend(known->second, Event::opened);
    if ((wanted & IN_CLOSE) != 0) pend(known->second, Event::closed);
    if (entry.mask != kFolderMask) continue;
    const bool named = (wanted & kFolderMask) != 0 && (name.empty() || name == entry.name);
    if (named || (mask & kFolderGone) != 0) pend(known->second, Event::changed);
  }
}

void FileEvents::lose() {
  for (const std::shared_ptr<Entry>& entry : entries_) pend(entry, Event::unknown);
}

void FileEvents::pend(const std::shared_ptr<Entry>& entry, Event event) {
  entry->events.push_back(event);
  if (entry->events.size() == 1) pending_.push_back(entry);
}

void FileEvents::wake() {
  for (const std::shared_ptr<Entry>& entry : std::exchange(pending_, {})) {
    if (!entry->gone && !entry->events.empty() && entry->callback)
      loop_->within(entry->fence, entry->callback);
  }
}

// Others' events came along with those that were asked for.
void FileEvents::wake_soon() {
  std::erase_if(pending_, [](const auto& entry) { return entry->gone || entry->events.empty(); });
  if (!pending_.empty()) loop_->within(nullptr, [this] { loop_->post([this] { wake(); }); });
}

void FileEvents::on_poll() {
  const bool early = loop_->now() < begins_;
  const bool begins = !early && std::exchange(begins_, Instant{}) != Instant{};
  bool unwatched = false;
  for (const std::shared_ptr<Entry>& entry : entries_) {
    if (entry->number != kUnwatched) continue;
    if (begins) watch(entry);
    if (entry->mask == kFolderMask) {
      if (begins) pend(entry, Event::unknown);  // what came before
      unwatched = unwatched || early;
      continue;
    }
    unwatched = unwatched || entry->number == kUnwatched;
    pend(entry, Event::unknown);
  }
  if (unwatched) poll_timer_.set_after(early ? kQuickPoll : kPoll);
  wake();
}

}  // namespace porttape
