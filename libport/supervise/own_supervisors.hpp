#pragma once

#include <functional>
#include <string>
#include <vector>

#include "libport/supervise/supervisor.hpp"

namespace porttape {

// A program that wants to supervise calls itself (a container's manager, a sandbox) cannot do so under
// another supervisor: the kernel has one for each. It gets the kernel's own EBUSY; that is told, once.
class OwnSupervisors final : public CallPart {
 public:
  explicit OwnSupervisors(std::function<void(const std::string&)> tell) : tell_(std::move(tell)) {}

  [[nodiscard]] std::vector<CallTrap> traps() const override;
  Decision decide(Supervisor& supervisor, const Call& call) override;

 private:
  std::function<void(const std::string&)> tell_;
  bool told_ = false;
};

}  // namespace porttape
