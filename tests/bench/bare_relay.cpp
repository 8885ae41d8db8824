#include "tests/bench/bare_relay.hpp"

#include <array>
#include <fcntl.h>
#include <filesystem>
#include <sys/epoll.h>
#include <sys/uio.h>

#include "libport/base/unique_fd.hpp"
#include "tests/bench/line.hpp"

namespace porttape::bench {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

struct Way {
  int from;
  int to;
  UniqueFd tape;
};

UniqueFd append_to(const std::string& path) {
  UniqueFd file(::open(path.c_str(), O_CREAT | O_WRONLY | O_APPEND | O_CLOEXEC, 0666));
  if (!file) throw_errno(path);
  return file;
}

void put_u32(Byte* out, std::int64_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) *out++ = static_cast<Byte>(value >> shift);
}

void pass_on(const Way& way) {
  std::array<Byte, 4096> data;
  const std::size_t size = read_some(way.from, data.data(), data.size());
  if (size == 0) throw BenchError("a line has ended");
  const std::int64_t now = now_ns();
  write_all(way.to, data.data(), size);
  std::array<Byte, 12> head;
  put_u32(head.data(), now / kSecond);
  put_u32(head.data() + 4, now % kSecond / 1000);
  put_u32(head.data() + 8, static_cast<std::int64_t>(size));
  const std::array<iovec, 2> block = {iovec{head.data(), head.size()}, iovec{data.data(), size}};
  if (::writev(way.tape.get(), block.data(), block.size()) < 0) throw_errno("tape");
}

}  // namespace

void relay_bare(const std::vector<BareLine>& lines) {
  std::vector<Pty> ptys;
  std::vector<UniqueFd> devices;
  std::vector<Way> ways;
  for (const BareLine& line : lines) {
    const int device = devices.emplace_back(open_port(line.device)).get();
    const Pty& pty = ptys.emplace_back(make_pty());
    ways.push_back({device, pty.master.get(), append_to(line.tape + "r")});
    ways.push_back({pty.master.get(), device, append_to(line.tape + "w")});
    std::filesystem::create_symlink(pty.slave, line.link);
  }
  const UniqueFd set(::epoll_create1(EPOLL_CLOEXEC));
  for (std::size_t n = 0; n < ways.size(); ++n) {
    epoll_event wanted{EPOLLIN, {.u64 = n}};
    if (::epoll_ctl(set.get(), EPOLL_CTL_ADD, ways[n].from, &wanted) != 0) throw_errno("epoll_ctl");
  }
  for (;;) {
    std::array<epoll_event, 128> ready;
    const int count = ::epoll_wait(set.get(), ready.data(), static_cast<int>(ready.size()), -1);
    if (count < 0) check_signals();
    for (int n = 0; n < count; ++n) pass_on(ways[ready.at(static_cast<std::size_t>(n)).data.u64]);
  }
}

}  // namespace porttape::bench
