#pragma once

#include <any>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <typeinfo>
#include <utility>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port.hpp"

namespace porttape {

class PortSpec;
struct PortContext;
struct PortOptions;

// One option of a port type or of a verb: how its value is checked, and what --help and messages say of it.
struct OptionSpec {
  enum class Kind { text, flag, integer, number, choice };

  std::string_view name;
  Kind kind = Kind::text;
  std::string_view default_value = {};
  std::string_view help = {};
  double min = 0;  // integer and number
  double max = std::numeric_limits<double>::max();
  // One that ends in `[:NAME]` may have a whole number behind it, up to 4294967295: `random[:SEED]`.
  std::vector<std::string_view> choices = {};
  std::string_view value_name = {};  // of a text or number, as --help shows it: FILE, PORT, BAUD
  std::string_view unit = {};        // of a number: s, ms, us
};

// What stands behind the option in --help: `FILE`, `MS`, `fail|warn`, `0|1|2`; nothing behind a flag.
std::string value_name(const OptionSpec& option);
// What --help says: the option's help, then the range of numbers and the default.
std::string help_of(const OptionSpec& option);
// The values that it takes, for messages: `milliseconds, 0 or more`.
std::string accepted_by(const OptionSpec& option);

// Checks a value and gives its canonical form ("1" and "" for flags). Errc::usage names option, value and
// what is accepted.
Result<std::string> check_value(const OptionSpec& option, std::string_view value);

using OptionValues = std::map<std::string, std::string>;

// An option that is none of these; `of` says whose they are (" of type tcp"). Names the nearest one, or all.
Error unknown_option(std::string_view name, std::span<const OptionSpec> options, std::string_view of = {});

// Checks each value and gives all in their canonical form; a flag that is off is left out. `of` is that of
// unknown_option().
Result<OptionValues> check_values(std::span<const OptionSpec> options, OptionValues values,
                                  std::string_view of = {});

// The options of a type, and behind them those that all ports have (CommonOptions).
std::vector<OptionSpec> with_common(std::vector<OptionSpec> options);

// The options that the main part of a short spelling sets: `MAIN`, or `MAIN:PORT` where there is a port.
struct ShortForm {
  std::string_view main;
  std::string_view port = {};
};

// Options as structs: one that `make` of the type knows, and one for each wrapper that the type was given.
class TypedOptions {
 public:
  template <class Options>
  static TypedOptions of(Options options) {
    TypedOptions typed;
    typed.set(std::move(options));
    return typed;
  }
  // Adds the struct, or replaces the one of its type.
  template <class Options>
  void set(Options options) {
    std::erase_if(structs_, [](const std::any& each) { return each.type() == typeid(Options); });
    structs_.emplace_back(std::move(options));
  }
  // Null where there is none of that type.
  template <class Options>
  [[nodiscard]] const Options* get() const {
    for (const std::any& each : structs_) {
      if (const auto* found = std::any_cast<Options>(&each)) return found;
    }
    return nullptr;
  }

 private:
  TypedOptions() = default;
  std::vector<std::any> structs_;
};

// All that is known of a port type, in one place: how it is spelled, its options, and what is made of them.
// Each room with ports gives its own (tty/types.hpp, net/types.hpp, taped/types.hpp); `catalog` has the
// table. A wrapper for any port is a function from a PortType to one, see wrapped() in port_options.hpp.
struct PortType {
  std::string_view name;
  ShortForm form;
  std::string_view help;
  std::vector<OptionSpec> options = {};
  ShortForm listening = {};           // of `NAME-listen:`, which also sets `listen`; none: no such spelling
  std::string_view recorded_as = {};  // the type that keeps a tape of it; none: it cannot be recorded
  std::string_view records = {};      // the type that it keeps a tape of
  bool keeps_datagrams = false;       // each write is one; such lines have no close
  bool exclusive = false;             // only one program's port can have the device open

  // The options as the struct that `make` takes, checked against each other. Errc::usage. The values have
  // been checked one by one.
  std::function<Result<TypedOptions>(const PortOptions&)> read = {};
  // Defaults that hang on other options; none: there are none.
  std::function<void(PortOptions&)> complete = {};
  // The port. `peer` says what is at the line's other end, for a tape's header.
  std::function<Result<std::unique_ptr<Port>>(const PortContext&, const PortSpec&, const std::string& peer)>
      make = {};
  // What only one port can have at a time (`link /tmp/x`, `TCP port *:2112`), a kind and where.
  using Claim = std::pair<std::string, std::string>;
  std::function<std::vector<Claim>(const PortSpec&)> claims = [](const PortSpec&) {
    return std::vector<Claim>();
  };

  [[nodiscard]] const OptionSpec* find(std::string_view option) const;
};

// Behind a type's name it makes the listening spelling.
inline constexpr std::string_view kListenSuffix = "-listen";

// The types that a program knows.
class PortTypes {
 public:
  explicit PortTypes(std::vector<PortType> types) : types_(std::move(types)) {}

  [[nodiscard]] std::span<const PortType> all() const { return types_; }
  [[nodiscard]] const PortType* find(std::string_view name) const;
  // `tcp, udp, …`, for messages.
  [[nodiscard]] std::string names() const;
  // All that a port's spelling may begin with: the names, and those with `-listen`.
  [[nodiscard]] std::vector<std::string> spellings() const;

 private:
  std::vector<PortType> types_;
};

}  // namespace porttape
