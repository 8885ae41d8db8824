#pragma once

#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include <boost/system/result.hpp>

#include "libport/base/error.hpp"

namespace porttape {

// Thrown by Result::value() on an error: a programming mistake, since the caller did not look.
class UncheckedError : public std::logic_error {
 public:
  explicit UncheckedError(const Error& error) : std::logic_error(error.message) {}
};

[[noreturn]] inline void throw_exception_from_error(const Error& error, const boost::source_location&) {
  throw UncheckedError(error);
}

// A T or an Error. Expected failures travel in it; exceptions are for programming errors. * and -> are
// checked as value() is.
template <class T>
class [[nodiscard]] Result : public boost::system::result<T, Error> {
 public:
  using boost::system::result<T, Error>::result;

  template <class U = T>
  requires(!std::is_void_v<U>) U& operator*() & { return this->value(); }
  template <class U = T>
  requires(!std::is_void_v<U>) const U& operator*() const& { return this->value(); }
  template <class U = T>
  requires(!std::is_void_v<U>) U* operator->() { return &this->value(); }
  template <class U = T>
  requires(!std::is_void_v<U>) const U* operator->() const { return &this->value(); }
};

inline Error make_error(Errc code, std::string message) { return Error{code, std::move(message)}; }
inline Error usage_error(std::string message) { return make_error(Errc::usage, std::move(message)); }

}  // namespace porttape
