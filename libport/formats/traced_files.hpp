#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What happened on a line.
struct TracedStep {
  std::int64_t us = 0;
  std::variant<Event, std::pair<Direction, Bytes>> what;
  // Of a call that others interrupted: its end. It may have happened before what ended earlier.
  std::optional<std::int64_t> until_us{};
  std::uint64_t line = 0;
};

// One open() of a traced program, which several descriptors may refer to.
struct TracedFile {
  std::string path;
  bool is_device = false;  // the one that the tape is of
  bool is_socket = false;
  bool may_be_device = false;  // that shows later; until then its steps are kept
  std::int64_t opened_us = 0;
  std::vector<TracedStep> steps{};
};

// Which descriptors of which thread refer to what, by the calls that change that (open and what is like it is
// told; dup, close, fork, execve, exit are followed). A thread that is not known yet, since its fork has not
// returned, is taken for a child of the one that was seen last.
class TracedFiles {
 public:
  using File = std::shared_ptr<TracedFile>;

  void open(std::uint32_t thread, int fd, File file, bool close_on_exec);
  void close(std::uint32_t thread, int fd);
  void close_range(std::uint32_t thread, unsigned first, unsigned last);
  void copy(std::uint32_t thread, int from, int to, bool close_on_exec);
  void set_close_on_exec(std::uint32_t thread, int fd, bool on);
  void fork(std::uint32_t thread, std::uint32_t child, bool shares);
  void exec(std::uint32_t thread);
  void exit(std::uint32_t thread);

  [[nodiscard]] File find(std::uint32_t thread, int fd);

 private:
  struct Descriptor {
    File file;
    bool close_on_exec = false;
  };
  using Table = std::map<int, Descriptor>;
  Table& table_of(std::uint32_t thread);

  std::map<std::uint32_t, std::shared_ptr<Table>> tables_;
  std::shared_ptr<Table> last_;
};

}  // namespace porttape
