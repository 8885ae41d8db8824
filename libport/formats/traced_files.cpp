#include "libport/formats/traced_files.hpp"

#include <utility>

namespace porttape {

TracedFiles::Table& TracedFiles::table_of(std::uint32_t thread) {
  std::shared_ptr<Table>& table = tables_[thread];
  if (!table) table = last_ ? last_ : std::make_shared<Table>();
  last_ = table;
  return *table;
}

void TracedFiles::open(std::uint32_t thread, int fd, File file, bool close_on_exec) {
  table_of(thread).insert_or_assign(fd, Descriptor{std::move(file), close_on_exec});
}

void TracedFiles::close(std::uint32_t thread, int fd) { table_of(thread).erase(fd); }

void TracedFiles::close_range(std::uint32_t thread, unsigned first, unsigned last) {
  std::erase_if(table_of(thread), [&](const auto& each) {
    const auto fd = static_cast<unsigned>(each.first);
    return fd >= first && fd <= last;
  });
}

void TracedFiles::copy(std::uint32_t thread, int from, int to, bool close_on_exec) {
  if (from == to) return;
  Table& table = table_of(thread);
  const auto found = table.find(from);
  if (found == table.end()) {
    table.erase(to);
  } else {
    const File file = found->second.file;
    table.insert_or_assign(to, Descriptor{file, close_on_exec});
  }
}

void TracedFiles::set_close_on_exec(std::uint32_t thread, int fd, bool on) {
  Table& table = table_of(thread);
  if (const auto found = table.find(fd); found != table.end()) found->second.close_on_exec = on;
}

void TracedFiles::fork(std::uint32_t thread, std::uint32_t child, bool shares) {
  (void)table_of(thread);
  const std::shared_ptr<Table> table = tables_[thread];
  std::shared_ptr<Table>& of_child = tables_[child];
  if (of_child && of_child != table) return;  // it has gone its own way meanwhile
  of_child = shares ? table : std::make_shared<Table>(*table);
}

// It has its descriptors for itself from then on.
void TracedFiles::exec(std::uint32_t thread) {
  auto table = std::make_shared<Table>(table_of(thread));
  std::erase_if(*table, [](const auto& each) { return each.second.close_on_exec; });
  tables_[thread] = std::move(table);
}

void TracedFiles::exit(std::uint32_t thread) {
  const auto table = tables_.find(thread);
  if (table == tables_.end()) return;
  if (last_ == table->second) last_.reset();
  tables_.erase(table);
}

TracedFiles::File TracedFiles::find(std::uint32_t thread, int fd) {
  const Table& table = table_of(thread);
  const auto found = table.find(fd);
  return found == table.end() ? nullptr : found->second.file;
}

}  // namespace porttape
