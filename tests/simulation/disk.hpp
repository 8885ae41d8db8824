#pragma once

#include <functional>
#include <string_view>

#include "tests/simulation/kernel.hpp"

namespace porttape::simulation {

// What a disk does wrong. While one exists, each call for a file that was made meanwhile asks it first.
class Disk {
 public:
  enum class Call { open, write, sync, truncate };
  struct Trouble {
    Kernel::Moment takes{};                    // before it comes back
    int error = 0;                             // errno; none: it is done
    std::size_t most_bytes = ~std::size_t{0};  // that a write takes
  };
  using Policy = std::function<Trouble(Call)>;

  explicit Disk(Policy policy);
  ~Disk();
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;

 private:
  Policy policy_;
};

std::string_view name_of(Disk::Call call);

}  // namespace porttape::simulation
