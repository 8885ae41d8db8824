#include <flexiport/timeout.h>

namespace flexiport {
namespace {

constexpr int kNanosPerMicro = 1000;

}  // namespace

void Timeout::AsTimeval(timeval& dest) const {
  dest.tv_sec = _sec;
  dest.tv_usec = _usec;
}

void Timeout::FromTimeval(const timeval& src) {
  _sec = static_cast<int>(src.tv_sec);
  _usec = static_cast<int>(src.tv_usec);
}

void Timeout::AsTimespec(timespec& dest) const {
  dest.tv_sec = _sec;
  dest.tv_nsec = static_cast<long>(_usec) * kNanosPerMicro;
}

void Timeout::FromTimespec(const timespec& src) {
  _sec = static_cast<int>(src.tv_sec);
  _usec = static_cast<int>(src.tv_nsec / kNanosPerMicro);
}

Timeout& Timeout::operator=(const Timeout& rhs) {
  _sec = rhs._sec;
  _usec = rhs._usec;
  return *this;
}

Timeout& Timeout::operator=(const timeval& rhs) {
  FromTimeval(rhs);
  return *this;
}

Timeout& Timeout::operator=(const timespec& rhs) {
  FromTimespec(rhs);
  return *this;
}

}  // namespace flexiport
