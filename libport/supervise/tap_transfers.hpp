#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <optional>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/supervise/supervisor.hpp"
#include "libport/supervise/tapped_files.hpp"
#include "libport/supervise/tapped_line.hpp"

namespace porttape {

// The reads and writes of programs on their own device, done here on a duplicate of their descriptor and told
// to a TappedLine: what is told are the bytes that the kernel took or gave. A call that would wait is kept,
// and tried again when the device can. Loop thread only; outlives the supervisor's kept calls.
class TapTransfers {
 public:
  struct Calls {
    std::function<void()> on_idle;  // the last one that waited does not any more
    // What the user should know, for each transfer that tells of it.
    std::function<void(const std::string& what)> tell;
  };

  TapTransfers(Loop& loop, TappedLine& line, TappedFiles& files, Calls calls);

  // A read or write of `file`, the device: also by several parts.
  CallPart::Decision decide(Supervisor& supervisor, const Call& call, std::shared_ptr<TappedFile> file);
  // Whether any waits: it has the device, whatever has become of its descriptor.
  [[nodiscard]] bool any_waits() const { return !kept_.empty(); }

 private:
  struct Transfer;

  void on_ready();
  void on_ready_file(const std::shared_ptr<TappedFile>& file);
  bool read_on(const std::shared_ptr<TappedFile>& file);
  bool watch(Transfer& transfer);
  bool arm(TappedFile& file, std::uint32_t events);
  void end(Transfer& transfer);
  void let_go(Transfer& transfer);
  void break_off(Transfer& transfer);
  void keep(Supervisor& supervisor, const std::shared_ptr<Transfer>& transfer);
  void wait(const std::shared_ptr<KeptCall>& kept, const std::shared_ptr<Transfer>& transfer);
  void go_on(const std::shared_ptr<Transfer>& transfer);
  std::optional<Outcome> read_now(Transfer& transfer);
  std::optional<std::size_t> readable_now(Transfer& transfer) const;
  std::optional<Outcome> write_now(Transfer& transfer);
  void wrote(int fd, ByteView data);
  void got(int fd, ByteView data);
  void tell_line_changes(std::string_view setting, std::string_view what);

  Loop* loop_;
  TappedLine* line_;
  TappedFiles* files_;
  // Of the devices that are waited for: a watch of the loop's on the file itself would make it O_NONBLOCK for
  // the program, too.
  std::shared_ptr<UniqueFd> ready_;
  std::optional<FdWatch> ready_watch_;  // none: they are looked at by the clock
  std::map<std::uint64_t, std::weak_ptr<TappedFile>> watched_;
  Calls calls_;
  std::list<std::shared_ptr<Transfer>> kept_;
  // Writes that wait: a tty takes one after the other, whole.
  std::list<std::shared_ptr<Transfer>> writers_;
  std::uint64_t number_ = 0;  // of the last that was watched
};

}  // namespace porttape
