#include "libport/tty/pty_names.hpp"

#include <iostream>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {

Result<void> PtyNames::publish(const std::string& slave) {
  if (!link_path_.empty()) {
    Result<PtyLink> link = PtyLink::publish(link_path_, slave);
    if (!link) return link.error();
    link_ = std::move(*link);
  }
  if (!bind_path_.empty()) {
    Result<PtyBind> bind = PtyBind::publish(bind_path_, slave);
    if (!bind) {
      link_.reset();
      return bind.error();
    }
    bind_.emplace(std::move(*bind));
  }
  if (link_) context_.log->info("{} is there ({})", link_->path(), slave);
  if (bind_) context_.log->info("{} is there, mounted ({})", bind_->path(), slave);
  print(slave);
  return {};
}

void PtyNames::retarget(const std::string& slave) {
  const auto move = [&](auto& name) {
    if (!name) return;
    if (Result<void> moved = name->retarget(slave); !moved) context_.log->error("{}", moved.error().message);
  };
  move(link_);
  move(bind_);
  print(slave);
}

void PtyNames::print(const std::string& slave) const {
  if (!link_ && !bind_ && context_.announces) std::cout << slave << std::endl;
}

PortPlace PtyNames::place(const std::string& slave) const {
  if (link_) return {.path = link_->path()};
  if (bind_) return {.path = bind_->path()};
  return {.path = slave};
}

}  // namespace porttape
