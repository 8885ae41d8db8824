#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

#include "libport/base/tty_device.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "libport/supervise/port_devices.hpp"
#include "libport/supervise/program_files.hpp"
#include "libport/supervise/supervisor.hpp"
#include "libport/supervise/tap_requests.hpp"
#include "libport/supervise/tap_transfers.hpp"
#include "libport/supervise/tapped_files.hpp"
#include "libport/supervise/tapped_line.hpp"
#include "libport/supervise/waiting_open.hpp"

namespace porttape {

// Tells a TappedLine what programs do with their own serial device. It opens the device for them and does
// their reads, writes and settings on a duplicate of their descriptor, so that what is told is what happened:
// with the counts and errors of the kernel, and never what another thread has put into a buffer meanwhile.
//
// The device is the first tty that is opened and can be a port (PortDevices), or the one that is named. The
// programs have it by descriptors from `files_from` on, which alone are trapped, and as stdin, stdout and
// stderr.
//
// A signal whose handler has no SA_RESTART ends a trapped call with EINTR when it comes before the supervisor
// has received the call, which takes some 4 µs; WAIT_KILLABLE_RECV helps only from then on, and no filter can
// help before. So as little as possible is trapped that programs do not expect EINTR of: no close (inotify
// tells of the last one), and no open whose flags say that it is of no device.
class TapCalls final : public CallPart {
 public:
  struct Options {
    std::optional<TtyDevice> device = {};  // none: the first that is opened
    // Of the programs that may have it open.
    std::function<std::vector<pid_t>()> processes;
    // What the user should know.
    std::function<void(const std::string&)> tell;
  };

  TapCalls(Loop& loop, TappedLine& line, Options options);
  ~TapCalls() override;
  TapCalls(const TapCalls&) = delete;
  TapCalls& operator=(const TapCalls&) = delete;

  [[nodiscard]] std::vector<CallTrap> traps() const override;
  Decision decide(Supervisor& supervisor, const Call& call) override;

 private:
  struct OpenArguments {
    std::string named;  // by the program
    int folder = 0;     // from there, where it is relative
    int flags = 0;
    bool own_way = false;  // resolved with rules of its own (openat2)
    // Once it was looked at: the file as it is opened here, whether it leads through what a process has open,
    // and whether to go there may wait for a file system.
    ProgramFile file = {};
    bool through_process = false;
    bool may_wait = false;
  };
  // Of a new descriptor.
  struct Place {
    enum class Kind {
      lowest,  // of those that are free
      number,  // `at`
      none     // the program may have no more
    };
    Kind kind = Kind::lowest;
    int at = 0;
  };
  using Keep = std::function<std::shared_ptr<KeptCall>()>;
  struct Holder {
    pid_t process = 0;
    UniqueFd file = {};  // a pidfd
    std::optional<FdWatch> watch = {};
    bool over = false;
  };

  [[nodiscard]] bool is_tapped(const Call& call, int fd) const;
  static std::optional<OpenArguments> open_arguments(const Call& call);
  Decision decide_open(Supervisor& supervisor, const Call& call);
  Decision look_elsewhere(Supervisor& supervisor, const Call& call, OpenArguments wanted);
  void looked(const std::weak_ptr<KeptCall>& waiting, const OpenArguments& wanted,
              const std::optional<TtyDevice>& device);
  Decision decide_device_open(const Keep& keep, const Call& call, const OpenArguments& wanted,
                              const TtyDevice& device);
  [[nodiscard]] std::string why_not_opened(const Call& call, const OpenArguments& wanted) const;
  Decision open_tapped(const Keep& keep, const Call& call, const OpenArguments& wanted,
                       const TtyDevice& device);
  Outcome not_opened_here(int error);
  Outcome opened(const Call& call, const OpenArguments& wanted, const TtyDevice& device, UniqueFd file);
  [[nodiscard]] std::optional<Place> place_for(const Call& call, std::uint32_t from) const;
  Outcome install(UniqueFd file, const Place& place, bool close_on_exec);
  void begin_line(int file, const std::string& path);
  void watch_closes(int file);
  Decision decide_copy(const Call& call);
  Decision decide_flags(const Call& call);
  Decision set_non_blocking(const Call& call, const TappedFile& file);
  [[nodiscard]] bool submits_to_device(const Call& call) const;
  [[nodiscard]] bool takes_device(const Call& call) const;
  Decision decide_device(Supervisor& supervisor, const Call& call);
  [[nodiscard]] bool holds(pid_t process) const;
  void watch_process(pid_t process);
  void look_for_holders();
  void tell_once(const std::string& what);
  void tell_unseen(const std::string& why, const std::string& what);
  void tell_no_place(const Call& call);
  void tell_moved(int at);

  Loop* loop_;
  TappedLine* line_;
  TappedFiles files_;
  TapTransfers transfers_;
  TapRequests requests_;
  Options options_;
  PortDevices ports_;
  std::uint32_t files_from_;
  std::optional<TtyDevice> device_;
  std::set<pid_t> restricted_;  // processes that have used Landlock
  Timer holders_timer_;
  std::vector<std::string> told_;
  std::vector<std::unique_ptr<Holder>> holders_;
  std::vector<std::unique_ptr<WaitingOpen>> opens_;
  std::map<std::string, std::unique_ptr<FileEvents::Watch>> closes_;  // by the path of the device's node
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

}  // namespace porttape
