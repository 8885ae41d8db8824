#pragma once

#include <concepts>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

#include "libport/base/error.hpp"

namespace porttape {

// Thrown by a Result that is asked for what it does not hold: a programming mistake, since the caller did not
// look.
class UncheckedError : public std::logic_error {
 public:
  explicit UncheckedError(const std::string& message) : std::logic_error(message) {}
};

// A T or an Error: what std::expected<T, Error> will be, with checked access. Expected failures travel in it;
// exceptions are for programming errors. T is neither a reference nor an Error.
template <class T>
class [[nodiscard]] Result {
 public:
  using value_type = T;

  Result() requires std::default_initializable<T> : held_(std::in_place_index<0>) {}
  // What converts to a T is the value, an Error is the error.
  template <class U = T>
  requires(std::convertible_to<U, T> && !std::same_as<std::remove_cvref_t<U>, Result> &&
           !std::same_as<std::remove_cvref_t<U>, Error>)
      Result(U&& value)  // NOLINT(bugprone-forwarding-reference-overload)
      : held_(std::in_place_index<0>, std::forward<U>(value)) {}
  Result(Error error) : held_(std::in_place_index<1>, std::move(error)) {}
  // A Result whose value converts.
  template <class U>
  requires(!std::same_as<U, T> && !std::is_void_v<U> && std::convertible_to<U, T>) Result(Result<U> other)
      : held_(other ? Held(std::in_place_index<0>, std::move(*other))
                    : Held(std::in_place_index<1>, std::move(other).error())) {}

  [[nodiscard]] bool has_value() const noexcept { return held_.index() == 0; }
  explicit operator bool() const noexcept { return has_value(); }

  // Throw UncheckedError where it holds an Error.
  [[nodiscard]] T& value() & { return checked(*this); }
  [[nodiscard]] const T& value() const& { return checked(*this); }
  [[nodiscard]] T value() && { return std::move(checked(*this)); }
  T& operator*() & { return checked(*this); }
  const T& operator*() const& { return checked(*this); }
  T operator*() && { return std::move(checked(*this)); }
  T* operator->() { return &checked(*this); }
  const T* operator->() const { return &checked(*this); }

  // An empty Error where it holds a value.
  [[nodiscard]] const Error& error() const& { return has_value() ? no_error() : std::get<1>(held_); }
  [[nodiscard]] Error error() && { return has_value() ? Error() : std::get<1>(std::move(held_)); }

  friend bool operator==(const Result& a, const Result& b) = default;

 private:
  using Held = std::variant<T, Error>;

  template <class Self>
  static auto& checked(Self& self) {
    if (auto* const value = std::get_if<0>(&self.held_)) return *value;
    throw UncheckedError(std::get<1>(self.held_).message);
  }

  Held held_;
};

// Done, or an Error.
template <>
class [[nodiscard]] Result<void> {
 public:
  using value_type = void;

  Result() = default;
  Result(Error error) : error_(std::move(error)) {}

  [[nodiscard]] bool has_value() const noexcept { return !error_; }
  explicit operator bool() const noexcept { return has_value(); }
  void value() const {
    if (error_) throw UncheckedError(error_->message);
  }
  [[nodiscard]] const Error& error() const& { return error_ ? *error_ : no_error(); }
  [[nodiscard]] Error error() && { return error_ ? *std::move(error_) : Error(); }

  friend bool operator==(const Result& a, const Result& b) = default;

 private:
  std::optional<Error> error_;
};

inline Error make_error(Errc code, std::string message) { return Error{code, std::move(message)}; }
inline Error usage_error(std::string message) { return make_error(Errc::usage, std::move(message)); }

}  // namespace porttape
