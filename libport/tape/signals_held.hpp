#pragma once

#include <initializer_list>
#include <signal.h>

namespace porttape {

// While it lives, SIGINT, SIGTERM and SIGHUP wait, as far as this thread would take them: who is ended
// between two steps would leave what the first one has made.
class SignalsHeld {
 public:
  SignalsHeld() {
    sigset_t ends{};
    ::sigemptyset(&ends);
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) ::sigaddset(&ends, number);
    (void)::pthread_sigmask(SIG_BLOCK, &ends, &before_);
  }
  SignalsHeld(const SignalsHeld&) = delete;
  SignalsHeld& operator=(const SignalsHeld&) = delete;
  ~SignalsHeld() { (void)::pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

 private:
  sigset_t before_{};
};

}  // namespace porttape
