// A real program with a tty of its own: what it finds is what it finds without a supervisor, and what it says
// is told.

#include "libport/supervise/tap_calls.hpp"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <termios.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/clock.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/timer.hpp"
#include "libport/supervise/caller_rights.hpp"
#include "libport/supervise/cooked_line.hpp"
#include "libport/supervise/supervised_command.hpp"
#include "libport/supervise/waiting_open.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

// What a session would be told.
class TappedEvents {
 public:
  explicit TappedEvents(TappedLine& line)
      : driver_port_(line.driver_port()),
        device_port_(line.device_port()),
        driver_(*this, "w "),
        device_(*this, "r ") {
    driver_port_->listen(driver_);
    device_port_->listen(device_);
    driver_port_->open();
  }

  void say(std::string what) {
    all.push_back(std::move(what));
    if (on_event) on_event(all.back());
  }

  std::vector<std::string> all;
  std::string written;
  std::string read;
  std::function<void(const std::string&)> on_event;
  bool opens_late = false;
  bool shows_settings = false;
  void open_device() { device_port_->open(); }

 private:
  class Side final : public PortListener {
   public:
    Side(TappedEvents& events, std::string prefix) : events_(&events), prefix_(std::move(prefix)) {}
    void on_up() override {
      if (!is_driver()) return;
      events_->say("open");
      if (!events_->opens_late) events_->open_device();
    }
    void on_data(ByteView data) override {
      const std::string text(data.begin(), data.end());
      (is_driver() ? events_->written : events_->read) += text;
      if (text.size() < 20) events_->say(prefix_ + text);
    }
    void on_drained() override {}
    void on_down(const LineDown& down) override {
      if (is_driver()) events_->device_port_->close();
      events_->say(down.reason == LineDown::Reason::lost ? "lost" : "close");
    }
    void on_finished(int) override {}
    void on_complete(int) override {}
    void told(const LineEvent& event) override {
      if (const auto* flush = std::get_if<line::Flush>(&event)) {
        events_->say(flush->queue == FlushQueue::in    ? "flush in"
                     : flush->queue == FlushQueue::out ? "flush out"
                                                       : "flush both");
      } else if (const auto* signal = std::get_if<LineSignal>(&event)) {
        events_->say(std::string(name_of(signal->name)) + (signal->on ? " on" : " off"));
      } else if (const auto* settings = std::get_if<line::Settings>(&event)) {
        if (events_->shows_settings) events_->say(to_text(settings->seen));
      } else if (std::holds_alternative<line::Drain>(event)) {
        events_->say("drain");
      } else if (const auto* lost = std::get_if<line::Dropped>(&event)) {
        events_->say(lost->bytes == 0 ? "missing" : "dropped");
      }
    }

   private:
    [[nodiscard]] bool is_driver() const { return prefix_ == "w "; }
    TappedEvents* events_;
    std::string prefix_;
  };

  std::unique_ptr<Port> driver_port_;
  std::unique_ptr<Port> device_port_;
  Side driver_;
  Side device_;
};

// The program's device, a pty. What comes after "give " is sent back, in two arrivals where there is a '|';
// "=" as it is.
class EchoDevice {
 public:
  explicit EchoDevice(Loop& loop)
      : master_(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)),
        rest_timer_(loop, [this] { send(std::exchange(rest_, {})); }) {
    ::grantpt(master_.get());
    ::unlockpt(master_.get());
    path = ::ptsname(master_.get());
    kept_.reset(::open(path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
    termios made{};
    ::tcgetattr(kept_.get(), &made);
    ::cfmakeraw(&made);
    ::tcsetattr(kept_.get(), TCSANOW, &made);
    watch_ = std::make_unique<FdWatch>(loop, master_.get(), [this] { answer(); });
    watch_->watch_readable(true);
  }

  // The program finds its line with these.
  void set_up(tcflag_t output, tcflag_t local) {
    termios made{};
    ::tcgetattr(kept_.get(), &made);
    made.c_oflag |= output;
    made.c_lflag |= local;
    ::tcsetattr(kept_.get(), TCSANOW, &made);
  }

  // What the program has written last.
  void catch_up() {
    while (answer()) {
    }
  }

  void hang_up() {
    watch_->stop();
    watch_.reset();
    master_.reset();
  }

  std::string path;
  std::string wire;

 private:
  bool answer() {
    std::array<char, 65536> some{};
    const ssize_t size = ::read(master_.get(), some.data(), some.size());
    if (size <= 0) return false;
    const std::string text(some.data(), static_cast<std::size_t>(size));
    wire += text;
    if (text.starts_with("=")) send(text);
    if (!text.starts_with("give ")) return true;
    const std::size_t bar = std::min(text.find('|'), text.size());
    send(text.substr(5, bar - 5));
    rest_ = text.substr(std::min(bar + 1, text.size()));
    if (!rest_.empty()) rest_timer_.set_after(milliseconds(30));
    return true;
  }
  void send(const std::string& text) { (void)!::write(master_.get(), text.data(), text.size()); }

  UniqueFd master_;
  UniqueFd kept_;
  std::unique_ptr<FdWatch> watch_;
  std::string rest_;
  Timer rest_timer_;
};

class TapCallsTest : public testing::Test {
 public:
  using Steps = std::vector<std::string>;

  Steps run(const Steps& steps, bool tapped) {
    std::vector<std::string> command{TAP_PROGRAM, device->path, dir / "result"};
    command.insert(command.end(), steps.begin(), steps.end());
    std::vector<std::unique_ptr<CallPart>> parts;
    std::vector<CallTrap> traps{{.number = SYS_getsid}};
    std::optional<pid_t> process;
    if (tapped) {
      std::optional<test::NoDescriptors> none;
      if (without_epoll) none.emplace(*without_epoll);
      parts.push_back(std::make_unique<TapCalls>(
          loop, line,
          TapCalls::Options{.processes = [&] { return processes_of(process); },
                            .tell = [this](const std::string& what) { told.push_back(what); }}));
      traps = Supervisor::traps(parts);
    }
    SupervisedCommand::Trouble trouble;
    std::optional<int> status;
    const auto running = SupervisedCommand::start(
        loop, {.command = command, .environment = {"PATH=/usr/bin:/bin"}, .traps = traps},
        [&](int wait_status) { status = wait_status; }, trouble);
    if (!running) {
      ADD_FAILURE() << trouble.message;
      return {};
    }
    process = running->command();
    if (!refused.empty()) {
      EXPECT_TRUE(test::refuse(refused));
    }
    const Supervisor supervisor(loop, running->take_listener(), std::move(parts));
    while (!status || (tapped && line.open())) loop.run_one();
    device->catch_up();
    EXPECT_TRUE(WIFEXITED(*status) && WEXITSTATUS(*status) == 0) << *status;
    return lines_of(dir / "result");
  }

  // The program and its children.
  static std::vector<pid_t> processes_of(const std::optional<pid_t>& process) {
    if (!process) return {};
    std::vector<pid_t> all{*process};
    std::ifstream children("/proc/" + std::to_string(*process) + "/task/" + std::to_string(*process) +
                           "/children");
    for (pid_t child = 0; children >> child;) all.push_back(child);
    return all;
  }

  // What comes of the steps, which is the same with and without the tap.
  Steps same(const Steps& steps) {
    events.all.clear();
    events.written.clear();
    events.read.clear();
    device = std::make_unique<EchoDevice>(loop);
    const Steps bare = run(steps, false);
    const std::string bare_wire = device->wire;
    device = std::make_unique<EchoDevice>(loop);
    const Steps tapped = run(steps, true);
    EXPECT_EQ(tapped, bare);
    EXPECT_EQ(device->wire, bare_wire);
    EXPECT_EQ(events.written, device->wire);
    return tapped;
  }
  Steps tap(const Steps& steps) {
    device = std::make_unique<EchoDevice>(loop);
    return run(steps, true);
  }

  static Steps lines_of(const std::string& path) {
    Steps all;
    std::ifstream file(path);
    for (std::string text; std::getline(file, text);) all.push_back(text);
    return all;
  }

  Loop loop;
  test::TempDir dir;
  TappedLine line;
  TappedEvents events{line};
  std::unique_ptr<EchoDevice> device;
  Steps told;
  std::optional<test::Unsanitized> without_epoll;  // set: TapCalls gets no descriptor
  std::vector<test::RefusedCall> refused;          // to us, once the program runs
};

TEST_F(TapCallsTest, AReadTakesWhatIsThereAndNoMore) {
  EXPECT_THAT(same({"open", "raw:1:0", "write:give abcdef", "read:4", "read:0", "read:9"}),
              ElementsAre("open 0", "write 11", "read 4 abcd", "read 0", "read 2 ef"));
  EXPECT_EQ(events.read, "abcdef");
  EXPECT_THAT(events.all, ElementsAre("open", "w give abcdef", "r abcd", "r ef", "close"));
}

TEST_F(TapCallsTest, AReadWaitsForVminBytes) {
  EXPECT_THAT(same({"open", "raw:5:0", "write:give ab|cde", "read:9"}),
              ElementsAre("open 0", "write 11", "read 5 abcde"));
  EXPECT_THAT(same({"open", "raw:5:0", "write:give ab|cde", "read:3", "raw:1:0", "all:2"}),
              ElementsAre("open 0", "write 11", "read 3 abc", "all 2 de"));
}

TEST_F(TapCallsTest, AReadOfBytesWithPausesEndsByVtime) {
  EXPECT_THAT(same({"open", "raw:9:1", "write:give abc", "read:9"}),
              ElementsAre("open 0", "write 8", "read 3 abc"));
}

TEST_F(TapCallsTest, AReadWithoutVminEndsByVtime) {
  EXPECT_THAT(same({"open", "raw:0:1", "read:9", "read:0", "raw:0:99", "write:give abc", "all:3"}),
              ElementsAre("open 0", "read 0", "read 0", "write 8", "all 3 abc"));
}

TEST_F(TapCallsTest, AReadWithoutBothNeverWaits) {
  EXPECT_THAT(same({"open", "raw:0:0", "read:9"}), ElementsAre("open 0", "read 0"));
}

TEST_F(TapCallsTest, ALineIsReadWhole) {
  EXPECT_THAT(same({"open", "lines", "write:give one\ntwo\n", "read:99", "read:1", "read:99"}),
              ElementsAre("open 0", "write 13", "read 4 one", "", "read 1 t", "read 3 wo", ""));
}

TEST_F(TapCallsTest, VectorsAreOneTransfer) {
  EXPECT_THAT(same({"open", "raw:5:0", "write:give 1234567", "vectors"}),
              ElementsAre("open 0", "write 12", "readv 7 1234567", "writev 5", "many EINVAL", "most 1024",
                          "negative EINVAL", "none 0"));
}

TEST_F(TapCallsTest, VectorsAtNoPlaceAreTransfersToo) {
  EXPECT_THAT(same({"open", "raw:1:0", "p2:give abc"}), ElementsAre("open 0", "pwritev2 8", "preadv2 3 abc"));
  EXPECT_EQ(events.read, "abc");
}

TEST_F(TapCallsTest, AWriteOfManyBytesEndsWithTheLast) {
  EXPECT_THAT(same({"open", "raw:1:0", "big:200000", "bigv:150000"}),
              ElementsAre("open 0", "big 200000", "bigv 150000"));
  EXPECT_EQ(events.written.size(), 350000U);
}

TEST_F(TapCallsTest, ABadAddressIsTheProgramsError) {
  EXPECT_THAT(same({"open", "raw:1:0", "bad"}),
              ElementsAre("open 0", "bad write EFAULT", "bad vector EFAULT", "half 2048", "last 3"));
  EXPECT_THAT(same({"open", "raw:1:0", "write:give a", "badread"}),
              ElementsAre("open 0", "write 6", "badread EFAULT"));
}

TEST_F(TapCallsTest, WhatWouldWaitIsRefusedWhereTheProgramWantsIt) {
  EXPECT_THAT(same({"open", "raw:1:0", "nonblock", "read:9", "fionbio:0", "write:give ab", "all:2",
                    "fionbio:1", "read:1"}),
              ElementsAre("open 0", "nonblock 1", "read EAGAIN", "fionbio 0", "write 7", "all 2 ab",
                          "fionbio 1", "read EAGAIN"));
}

TEST_F(TapCallsTest, NobodySeesTheFlagsThatAReadOfOursHas) {
  EXPECT_THAT(same({"open", "raw:1:0", "flags"}), ElementsAre("open 0", "flags 0"));
}

TEST_F(TapCallsTest, ASignalEndsARead) {
  EXPECT_THAT(same({"open", "raw:1:0", "alarm:20", "read:9"}), ElementsAre("open 0", "read EINTR"));
}

TEST_F(TapCallsTest, ASignalThatRestartsEndsNoRead) {
  EXPECT_THAT(same({"open", "raw:5:0", "alarm:10r", "write:give |abcde", "read:9"}),
              ElementsAre("open 0", "write 11", "read 5 abcde"));
}

TEST_F(TapCallsTest, ASignalOfAProcessInterruptsWhicheverThreadTakesIt) {
  EXPECT_THAT(same({"open", "raw:1:0", "threads"}), ElementsAre("open 0", "threads 0"));
}

TEST_F(TapCallsTest, ASignalEndsAReadOfAProcessWhoseFirstThreadHasEnded) {
  EXPECT_THAT(same({"open", "raw:1:0", "firstends"}), ElementsAre("open 0", "first ends 3"));
}

// More than one file can be watched for in the kernel (epoll(7): 1000).
TEST_F(TapCallsTest, ManyThreadsWaitForOneByteEach) {
  EXPECT_THAT(same({"open", "raw:1:0", "crowd:1500"}), ElementsAre("open 0", "crowd EINTR 1499"));
  EXPECT_EQ(events.read, std::string(1499, 'x'));
}

TEST_F(TapCallsTest, AProcessStopsWithAThreadThatReads) {
  EXPECT_THAT(same({"open", "raw:1:0", "stop"}), ElementsAre("open 0", "stop 1"));
}

TEST_F(TapCallsTest, AWriteIsWholeWhileAnotherThreadWrites) {
  EXPECT_THAT(tap({"open", "raw:1:0", "twowrites"}), ElementsAre("open 0", "two writes 0"));
  const std::string& wire = device->wire;
  ASSERT_EQ(wire.size(), 65'000U);
  EXPECT_EQ(events.written, wire);
  const std::string as(60'000, 'a');
  const std::string bs(5'000, 'b');
  EXPECT_TRUE(wire == as + bs || wire == bs + as);
}

TEST_F(TapCallsTest, WhatIsReadWhileItsDescriptorIsClosedIsTold) {
  EXPECT_THAT(same({"open", "raw:1:0", "closeunder"}), ElementsAre("open 0", "close under read 4 late"));
  EXPECT_EQ(events.read, "late");
}

TEST_F(TapCallsTest, ASignalEndsAReadWithTheBytesThatItHas) {
  EXPECT_THAT(same({"open", "raw:5:0", "write:give ab", "arrived:2", "alarm:50", "read:9"}),
              ElementsAre("open 0", "write 7", "read 2 ab"));
  EXPECT_EQ(events.read, "ab");
}

TEST_F(TapCallsTest, CopiesAreTheDeviceAndTheLastOnesCloseIsTold) {
  EXPECT_THAT(
      same({"open", "raw:1:0", "copy:dup", "write:a", "copy:dupfd", "write:b", "copy:dup2", "write:c",
            "close"}),
      ElementsAre("open 0", "dup 0", "write 1", "dupfd 0", "write 1", "dup2 0 at 0", "write 1", "close 0"));
  EXPECT_THAT(events.all, ElementsAre("open", "w a", "w b", "w c", "close"));
}

// The kernel ends a trapped call with EINTR when a signal comes before the call is received.
TEST_F(TapCallsTest, ASignalEndsNoClose) {
  EXPECT_THAT(tap({"open", "closes:4000"}), ElementsAre("open 0", "closes 0"));
}

TEST_F(TapCallsTest, TheLastCloseIsTheProgramsOwn) {
  EXPECT_THAT(tap({"lastcloses:300"}), ElementsAre("last closes 0"));
  EXPECT_EQ(events.all.front(), "open");
}

TEST_F(TapCallsTest, WithoutInotifyTheLastCloseIsToldToo) {
  loop.file_events().refuse();
  EXPECT_THAT(tap({"open", "raw:1:0", "write:a", "close"}), ElementsAre("open 0", "write 1", "close 0"));
  EXPECT_THAT(events.all, ElementsAre("open", "w a", "close"));
}

TEST_F(TapCallsTest, AnOpenThatIsOfNoDeviceIsNotTrapped) {
  const std::vector<CallTrap> traps = TapCalls(loop, line, {}).traps();
  const auto openat = std::ranges::find(traps, static_cast<int>(SYS_openat), &CallTrap::number);
  ASSERT_NE(openat, traps.end());
  EXPECT_EQ(openat->unless.argument, 2U);
  EXPECT_THAT(openat->unless.masks, ElementsAre(O_PATH, O_DIRECTORY, O_CREAT | O_EXCL));
}

TEST_F(TapCallsTest, WhatComesInItsPlaceIsNotTheDevice) {
  EXPECT_THAT(same({"open", "raw:1:0", "redirect"}), ElementsAre("open 0", "redirect 7 to pipe"));
  EXPECT_EQ(events.written, "to line");
}

TEST_F(TapCallsTest, WhatComesInItsPlaceAfterAnExecIsNotTheDevice) {
  EXPECT_THAT(same({"open", "raw:1:0", "become"}), ElementsAre("open 0", "before 6", "became"));
  EXPECT_EQ(events.written, "before");
  EXPECT_THAT(events.all, ElementsAre("open", "w before", "close"));
}

TEST_F(TapCallsTest, WhereNoDescriptorsAreComparedEachCallsIsLookedUp) {
  EXPECT_TRUE(test::holds_without({{.number = SYS_kcmp, .error = EPERM}}, [this] {
    EXPECT_THAT(same({"open", "raw:1:0", "write:give ab", "read:1", "read:1", "become"}),
                ElementsAre("open 0", "write 7", "read 1 a", "read 1 b", "before 6", "became"));
    EXPECT_THAT(events.all, ElementsAre("open", "w give ab", "r a", "r b", "w before", "close"));
  }));
}

TEST_F(TapCallsTest, ItIsOpenedByOtherCallsAndNamesToo) {
  EXPECT_THAT(same({"creat", "write:a"}), ElementsAre("creat 0", "write 1"));
  EXPECT_EQ(events.written, "a");
  EXPECT_THAT(same({"open", "raw:1:0", "reopen", "write:b"}), ElementsAre("open 0", "reopen 0", "write 1"));
  EXPECT_EQ(events.written, "b");
}

TEST_F(TapCallsTest, ItIsOpenedByItsNameHoweverThatIsWritten) {
  EXPECT_THAT(same({"openas:slashes", "write:a"}), ElementsAre("slashes 0", "write 1"));
  EXPECT_THAT(same({"openas:number", "write:b"}), ElementsAre("number 0", "write 1"));
  EXPECT_THAT(same({"openas:link", "write:c"}), ElementsAre("link 0", "write 1"));
  EXPECT_THAT(told, IsEmpty());
}

TEST_F(TapCallsTest, ANameMayBeAsLongAsTheKernelTakes) {
  for (const char* const how : {"long", "longown"}) {
    EXPECT_THAT(same({std::string("openas:") + how, "write:a"}),
                ElementsAre(std::string(how) + " 0", "write 1"));
  }
  EXPECT_THAT(told, IsEmpty());
}

TEST_F(TapCallsTest, ALinkThatIsNamedFromItsFolderLeadsToTheProgramsOwnFile) {
  EXPECT_THAT(same({"openas:nearlink", "write:a"}), ElementsAre("nearlink 0", "write 1"));
  EXPECT_THAT(same({"openas:chain", "write:b"}), ElementsAre("chain 0", "write 1"));
  EXPECT_THAT(told, IsEmpty());
}

TEST(WaitingOpenTest, ItOpensFromTheFoldersDescriptor) {
  Loop loop;
  const test::TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "fifo").c_str(), 0600), 0);
  std::optional<int> result;
  const auto folder = std::make_shared<const UniqueFd>(::open(dir.path().c_str(), O_PATH | O_CLOEXEC));
  const auto open = WaitingOpen::start(loop, {.path = "fifo", .folder = folder}, O_RDWR,
                                       [&](const UniqueFd&, int error) { result = error; });
  ASSERT_NE(open, nullptr);
  while (!result) loop.run_one();
  EXPECT_EQ(*result, 0);
}

// Who answers calls would wait for a program that waits for an answer.
TEST_F(TapCallsTest, AFileSystemThatAProgramOfItsServesIsNotWaitedFor) {
  const Steps bare = same({"openserved", "open", "write:hello", "close"});
  if (bare.front() == "nofuse 0") GTEST_SKIP() << "no file system of a program's own can be mounted here";
  EXPECT_THAT(bare, ElementsAre("served ENOENT", "written 9", "open 0", "write 5", "close 0"));
}

TEST_F(TapCallsTest, WhatTheKernelRefusesAtAnOpenIsRefused) {
  for (const char* const how : {"small", "mode", "unknown"})
    EXPECT_THAT(same({std::string("openas:") + how}), ElementsAre(std::string(how) + " EINVAL"));
  EXPECT_THAT(same({"openas:new"}), ElementsAre("new EEXIST"));
  EXPECT_THAT(events.all, Not(Contains("open")));
  EXPECT_THAT(same({"openas:plain", "write:a"}), ElementsAre("plain 0", "write 1"));
  EXPECT_EQ(events.written, "a");
}

TEST_F(TapCallsTest, AWriteThatIsToBeSafeIsOneAsAnyOther) {
  EXPECT_THAT(same({"open", "raw:1:0", "dsync:safe"}), ElementsAre("open 0", "dsync 4"));
}

TEST_F(TapCallsTest, WhatIsGivenToTheKernelForLaterIsRefusedForTheDeviceAlone) {
  EXPECT_THAT(tap({"open", "raw:1:0", "aio"}), ElementsAre("open 0", "aio EINVAL", "aio elsewhere 1"));
}

TEST_F(TapCallsTest, ADescriptorThatIsTakenFromAProcessIsTold) {
  EXPECT_THAT(tap({"open", "getfd"}), ElementsAre("open 0", "getfd 0"));
  EXPECT_THAT(told, ElementsAre(HasSubstr("pidfd_getfd")));
}

TEST_F(TapCallsTest, AReadChangesNoMemoryThatTheProgramMayOnlyRead) {
  EXPECT_THAT(same({"open", "raw:3:0", "write:give abc", "readonly"}),
              ElementsAre("open 0", "write 8", "readonly EFAULT", "untouched 1"));
}

TEST_F(TapCallsTest, ACopyIsTheLowestThatIsFree) {
  EXPECT_THAT(same({"open", "raw:1:0", "copy:dup0", "write:a"}),
              ElementsAre("open 0", "dup0 0 at 0", "write 1"));
  EXPECT_THAT(same({"open0", "raw:1:0", "write:b"}), ElementsAre("open0 0", "write 1"));
}

TEST_F(TapCallsTest, AChildThatHasItAloneIsWaitedFor) {
  EXPECT_THAT(same({"open", "raw:1:0", "fork"}), ElementsAre("open 0", "child 0"));
  EXPECT_THAT(events.all, ElementsAre("open", "w child", "close"));
}

TEST_F(TapCallsTest, FlushesDrainsAndBreaksHaveTheirPlace) {
  EXPECT_THAT(tap({"open", "raw:1:0", "write:a", "flush:0", "write:b", "flush:1", "flush:2", "drain",
                   "write:c", "tcsbrk", "write:d", "sbrk"}),
              ElementsAre("open 0", "write 1", "flush 0", "write 1", "flush 0", "flush 0", "drain 0",
                          "write 1", "tcsbrk 0", "write 1", "sbrk 0", "cbrk 0"));
  EXPECT_THAT(events.all,
              ElementsAre("open", "w a", "flush in", "w b", "flush out", "flush both", "drain", "w c",
                          "break on", "break off", "w d", "break on", "break off", "close"));
}

TEST_F(TapCallsTest, WhatASettingsRequestMakesHasItsPlace) {
  events.shows_settings = true;
  EXPECT_THAT(
      tap({"open", "raw:1:0", "write:a", "set:now:7E", "write:b", "set:drain:8O", "write:c", "set:flush:7E",
           "badset"}),
      ElementsAre("open 0", "write 1", "set 0", "write 1", "set 0", "write 1", "set 0", "badset EFAULT"));
  const auto from_a = std::ranges::find(events.all, "w a");
  EXPECT_THAT(std::vector(from_a, events.all.end()),
              ElementsAre("w a", "9600 baud, 7E1", "w b", "19200 baud, 8O1", "w c", "flush in",
                          "9600 baud, 7E1", "close"));
}

TEST_F(TapCallsTest, ThatReadsAreNotToWaitIsNoSettingOfTheLine) {
  events.shows_settings = true;
  EXPECT_THAT(tap({"open", "raw:1:0", "write:a", "fionbio:1", "read:1", "fionbio:0", "write:b"}),
              ElementsAre("open 0", "write 1", "fionbio 1", "read EAGAIN", "fionbio 0", "write 1"));
  const auto from_a = std::ranges::find(events.all, "w a");
  EXPECT_THAT(std::vector(from_a, events.all.end()), ElementsAre("w a", "w b", "close"));
}

// A pty has no modem lines: the calls by which they are asked for and driven are answered as by a device all
// of whose lines are off.
TEST_F(TapCallsTest, LinesOfTheDeviceAndOfTheDriverAreTold) {
  EXPECT_TRUE(test::holds_without({}, [this] {
    refused = {test::refused_ioctl(TIOCMGET, 0), test::refused_ioctl(TIOCMBIS, 0),
               test::refused_ioctl(TIOCMBIC, 0), test::refused_ioctl(TIOCMSET, 0)};
    EXPECT_THAT(tap({"open", "raw:1:0", "write:a", "mbis:dtr,rts", "mbis:dtr", "mbic:rts", "mset:rts", "mget",
                     "mset:", "badlines"}),
                ElementsAre("open 0", "write 1", "mbis 0", "mbis 0", "mbic 0", "mset 0", "mget 0", "mset 0",
                            "badlines EFAULT"));
    EXPECT_THAT(events.all, ElementsAre("open", "cts off", "dsr off", "cd off", "ri off", "w a", "dtr on",
                                        "rts on", "rts off", "dtr off", "rts on", "close"));
  }));
}

TEST_F(TapCallsTest, WhatTheDeviceRefusesOfItsLinesIsTheProgramsError) {
  EXPECT_TRUE(test::holds_without({}, [this] {
    refused = {test::refused_ioctl(TIOCMGET, EIO), test::refused_ioctl(TIOCMBIS, EIO),
               test::refused_ioctl(TCFLSH, EIO), test::refused_ioctl(TIOCCBRK, EIO)};
    const Steps said = tap({"open", "raw:1:0", "mget", "mbis:dtr", "flush:0", "sbrk", "write:a"});
    EXPECT_THAT(said,
                ElementsAre("open 0", "mget EIO", "mbis EIO", "flush EIO", "sbrk 0", "cbrk EIO", "write 1"));
    EXPECT_THAT(events.all, ElementsAre("open", "break on", "w a", "close"));
  }));
}

TEST_F(TapCallsTest, ABreakOfNoLengthIsAQuarterOfASecond) {
  const Instant begin = machine_clock().now();
  EXPECT_THAT(tap({"open", "raw:1:0", "longbreak"}), ElementsAre("open 0", "longbreak 0"));
  EXPECT_GE(machine_clock().now() - begin, milliseconds(250));
  EXPECT_THAT(events.all, ElementsAre("open", "break on", "break off", "close"));
}

TEST_F(TapCallsTest, ALineThatHangsUpIsLostOnce) {
  events.on_event = [this](const std::string& what) {
    if (what == "w go") loop.post([this] { device->hang_up(); });
  };
  EXPECT_THAT(tap({"open", "raw:1:0", "write:go", "read:9", "write:x"}).back(), "write EIO");
  EXPECT_EQ(std::ranges::count(events.all, "lost"), 1);
}

TEST_F(TapCallsTest, WhatIsReadBeforeTheSessionIsReadyIsKept) {
  events.opens_late = true;
  events.on_event = [this](const std::string& what) {
    if (what == "w over") events.open_device();
  };
  (void)tap({"open", "raw:1:0", "write:give ab", "all:2", "write:over"});
  EXPECT_EQ(events.read, "ab");
}

TEST_F(TapCallsTest, WithoutEpollAReadIsLookedAt) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  without_epoll = unsanitized;
  EXPECT_THAT(same({"open", "raw:5:0", "write:give |abcde", "read:9"}),
              ElementsAre("open 0", "write 11", "read 5 abcde"));
}

TEST_F(TapCallsTest, AProgramThatMayHaveFewFilesIsToldOf) {
  EXPECT_THAT(tap({"few", "open", "raw:1:0", "write:a"}), ElementsAre("open 0", "write 1"));
  EXPECT_THAT(told, Contains(HasSubstr("limit of open files")));
  EXPECT_THAT(events.all, Not(Contains("open")));
  EXPECT_TRUE(line.was_unseen());
}

TEST_F(TapCallsTest, WhatIsMovedWhereItIsNotSeenIsMissingOnTheTape) {
  EXPECT_THAT(tap({"open", "raw:1:0", "write:a", "copy:dup20", "write:b"}),
              ElementsAre("open 0", "write 1", "dup20 0", "write 1"));
  EXPECT_THAT(told, ElementsAre(HasSubstr("moved its device to descriptor 20")));
  EXPECT_THAT(events.all, ElementsAre("open", "w a", "missing", "close"));
}

// The tape is of what the program does: where the wire differs, that is told, once.
TEST_F(TapCallsTest, ThatTheLineSendsOtherBytesThanItIsGivenIsTold) {
  device = std::make_unique<EchoDevice>(loop);
  device->set_up(OPOST | ONLCR, 0);
  EXPECT_THAT(run({"open", "write:a"}, true), ElementsAre("open 0", "write 1"));
  EXPECT_THAT(told, IsEmpty()) << "there was nothing to change";
  EXPECT_THAT(run({"open", "write:b\n", "write:c\n"}, true), ElementsAre("open 0", "write 2", "write 2"));
  EXPECT_THAT(told, ElementsAre(HasSubstr("'onlcr' the device's line sends other bytes")));
  EXPECT_EQ(device->wire, "ab\r\nc\r\n");
  EXPECT_EQ(events.written, "ab\nc\n");
}

TEST_F(TapCallsTest, ThatTheLineSendsBackWhatComesIsTold) {
  device = std::make_unique<EchoDevice>(loop);
  device->set_up(0, ECHO);
  EXPECT_THAT(run({"open", "write:give x", "read:1"}, true), ElementsAre("open 0", "write 6", "read 1 x"));
  EXPECT_THAT(told, ElementsAre(HasSubstr("'echo' the device's line sends back")));
  EXPECT_EQ(device->wire, "give xx");
}

TEST(CookedLine, EachSettingCountsForTheBytesThatItChanges) {
  const auto changed = [](tcflag_t output, std::string_view data) {
    termios line{};
    line.c_oflag = output;
    return changed_when_written(line, as_bytes(data));
  };
  EXPECT_EQ(changed(OPOST | ONLCR, "a\n"), "onlcr");
  EXPECT_EQ(changed(OPOST | ONLCR, "a\r\t"), "");
  EXPECT_EQ(changed(OPOST | OCRNL, "\r"), "ocrnl");
  EXPECT_EQ(changed(OPOST | ONOCR, "\r"), "onocr");
  EXPECT_EQ(changed(OPOST | XTABS, "\t"), "tab3");
  EXPECT_EQ(changed(OPOST | OLCUC, "Az"), "olcuc");
  EXPECT_EQ(changed(OPOST | OLCUC, "AZ{`"), "");
  EXPECT_EQ(changed(OPOST | OCRNL | ONOCR | XTABS, "az\n"), "");
  EXPECT_EQ(changed(ONLCR | OCRNL | ONOCR | XTABS | OLCUC, "a\n\r\t"), "") << "without opost none counts";
  termios line{};
  EXPECT_EQ(sent_back_when_read(line, as_bytes("a")), "");
  line.c_lflag = ECHO;
  EXPECT_EQ(sent_back_when_read(line, as_bytes("a")), "echo");
  EXPECT_EQ(sent_back_when_read(line, {}), "");
}

TEST_F(TapCallsTest, NoFileOfAnotherThreadIsReplaced) {
  EXPECT_THAT(tap({"race:300"}), ElementsAre("race 0"));
}

TEST_F(TapCallsTest, WhereManyFilesAreOpenTheNumberIsTheKernels) {
  EXPECT_THAT(same({"fill", "open", "raw:1:0", "number", "write:a", "copy:dup", "number", "write:b"}),
              ElementsAre("open 0", "number 1000", "write 1", "dup 0", "number 1001", "write 1"));
}

// What it opens then is the kernel's to judge, in either case the same.
class TapCallsOfAProgramThatGivesUpRights : public TapCallsTest {
 public:
  void expect_opened_by_itself(const std::string& how, const std::string& why) {
    device = std::make_unique<EchoDevice>(loop);
    const Steps bare = run({"giveup:" + how, "open"}, false);
    if (!bare.empty() && bare.front() == "cannot") GTEST_SKIP() << how << " is not to be had here";
    EXPECT_EQ(tap({"giveup:" + how, "open"}), bare);
    EXPECT_THAT(told, ElementsAre(HasSubstr(why)));
    EXPECT_THAT(events.all, Not(Contains("open")));
  }
};

TEST_F(TapCallsOfAProgramThatGivesUpRights, OneInAUserNamespaceOfItsOwnOpensItself) {
  expect_opened_by_itself("users", "another user namespace");
}

TEST_F(TapCallsOfAProgramThatGivesUpRights, OneInAnotherMountOfTheSameRootOpensItself) {
  expect_opened_by_itself("root", "the files that it sees are others");
}

TEST_F(TapCallsOfAProgramThatGivesUpRights, OneThatRestrictsItselfByLandlockOpensItself) {
  expect_opened_by_itself("landlock", "Landlock");
}

TEST(CallerLineage, BeginsWithTheProcessAndGoesOnWithItsParents) {
  std::vector<pid_t> of_thread;
  std::thread([&] { of_thread = lineage_of(::gettid()); }).join();
  ASSERT_GE(of_thread.size(), 1U);
  EXPECT_EQ(of_thread.front(), ::getpid());
  if (::getppid() > 1) {
    ASSERT_GE(of_thread.size(), 2U);
    EXPECT_EQ(of_thread[1], ::getppid());
  }
  EXPECT_TRUE(lineage_of(-1).empty());
}

TEST_F(TapCallsOfAProgramThatGivesUpRights, WhatItHasOpenStaysOnTheTape) {
  EXPECT_THAT(tap({"open", "raw:1:0", "giveup:landlock", "write:a"}).back(), "write 1");
  EXPECT_THAT(events.all, Contains("w a"));
}

TEST(WaitingOpenTest, ItWaitsAsTheKernelDoes) {
  Loop loop;
  const test::TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "fifo").c_str(), 0600), 0);
  std::optional<int> result;
  UniqueFd got;
  const auto done = [&](UniqueFd file, int error) {
    got = std::move(file);
    result = error;
  };
  const auto open = WaitingOpen::start(loop, {.path = dir / "fifo"}, O_RDONLY, done);
  ASSERT_NE(open, nullptr);
  const UniqueFd other(::open((dir / "fifo").c_str(), O_RDWR | O_CLOEXEC));
  while (!result) loop.run_one();
  EXPECT_TRUE(got);
  EXPECT_TRUE(open->over());
}

TEST(WaitingOpenTest, WhatTheKernelRefusesIsTold) {
  Loop loop;
  std::optional<int> result;
  const auto open = WaitingOpen::start(loop, {.path = "/no/such/tty"}, O_RDWR,
                                       [&](const UniqueFd&, int error) { result = error; });
  ASSERT_NE(open, nullptr);
  while (!result) loop.run_one();
  EXPECT_EQ(*result, ENOENT);
}

TEST(WaitingOpenTest, DestroyedItIsBrokenOff) {
  Loop loop;
  const test::TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "fifo").c_str(), 0600), 0);
  auto open = WaitingOpen::start(loop, {.path = dir / "fifo"}, O_RDONLY, [](UniqueFd, int) { FAIL(); });
  ASSERT_NE(open, nullptr);
  open.reset();
  EXPECT_EQ(::open((dir / "fifo").c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC), -1);  // nobody waits to read
  EXPECT_EQ(errno, ENXIO);
}

}  // namespace
}  // namespace porttape
