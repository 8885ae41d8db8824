// restricted FAMILY… -- COMMAND…: runs the command under what a systemd unit with these address families does
// to a program: sockets of other families are refused, no new privileges, no privileged user.

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <grp.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <string_view>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace {

constexpr unsigned kNobody = 65534;

constexpr std::array<std::pair<std::string_view, unsigned>, 4> kFamilies = {
    {{"AF_UNIX", AF_UNIX}, {"AF_INET", AF_INET}, {"AF_INET6", AF_INET6}, {"AF_NETLINK", AF_NETLINK}}};

sock_filter statement(unsigned code, unsigned value) {
  return {static_cast<unsigned short>(code), 0, 0, value};
}
sock_filter unless_equal(unsigned value, unsigned char skip) {
  return {static_cast<unsigned short>(BPF_JMP | BPF_JEQ | BPF_K), 0, skip, value};
}

// socket(2) with another family than these fails with EAFNOSUPPORT.
std::vector<sock_filter> filter_for(const std::vector<unsigned>& families) {
  std::vector<sock_filter> filter = {
      statement(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      {static_cast<unsigned short>(BPF_JMP | BPF_JEQ | BPF_K), 1, 0, __NR_socket},
      statement(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
      statement(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, args)),
  };
  for (const unsigned family : families) {
    filter.push_back(unless_equal(family, 1));
    filter.push_back(statement(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  }
  filter.push_back(statement(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EAFNOSUPPORT));
  return filter;
}

bool restrict_to(const std::vector<unsigned>& families) {
  if (::geteuid() == 0 && (::setgroups(0, nullptr) != 0 || ::setgid(kNobody) != 0 || ::setuid(kNobody) != 0))
    return false;
  std::vector<sock_filter> filter = filter_for(families);
  const sock_fprog program{static_cast<unsigned short>(filter.size()), filter.data()};
  return ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<unsigned> families;
  int n = 1;
  for (; n < argc && std::string_view(argv[n]) != "--"; ++n) {
    for (const auto& [name, family] : kFamilies) {
      if (name == argv[n]) families.push_back(family);
    }
  }
  if (n + 1 >= argc || !restrict_to(families)) {
    std::fprintf(stderr, "restricted: %s\n", n + 1 >= argc ? "no command" : std::strerror(errno));
    return 77;
  }
  ::execvp(argv[n + 1], argv + n + 1);
  std::perror("restricted");
  return 77;
}
