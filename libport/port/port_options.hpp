#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/port/port_type.hpp"

namespace porttape {

// A port as a user writes it: a type and the options that were given, each value checked and in its canonical
// form. Read into a PortSpec at the edge of the program; only PortType::read asks for single options.
struct PortOptions {
  const PortType* type = nullptr;  // of a PortTypes, which outlives it
  OptionValues values;             // a boolean option has the value "1" when on; absent when off

  [[nodiscard]] bool has(const std::string& option) const { return values.contains(option); }
  // The option's value, or the type's default for it.
  [[nodiscard]] std::string text(const std::string& option) const;
  [[nodiscard]] bool flag(const std::string& option) const { return has(option); }
  [[nodiscard]] long integer(const std::string& option) const { return static_cast<long>(number(option)); }
  [[nodiscard]] double number(const std::string& option) const;
  // Permissions, as chmod(1) takes them. Errc::usage.
  [[nodiscard]] Result<unsigned> mode(const std::string& option) const;

  // The short spelling of its main part, for messages: `serial:/dev/ttyUSB0`, `tcp-listen:127.0.0.1:20000`.
  [[nodiscard]] std::string name() const;
  // The same with every other option that was given, such as parse_options() reads (a comma within a value
  // apart, which no spelling has).
  [[nodiscard]] std::string spelled() const;

  friend bool operator==(const PortOptions&, const PortOptions&) = default;
};

// Reads either spelling: `type=serial,device=/dev/ttyUSB0,baud=115200` or `serial:/dev/ttyUSB0,baud=115200`;
// a bare `/dev/…` is `serial:`, `tcp-listen:127.0.0.1:2112` sets `listen`. Errc::usage names the option, its
// value and what would be accepted.
Result<PortOptions> parse_options(const PortTypes& types, std::string_view spec);

// The same checks for options that came as a map, the type as `type` among them.
Result<PortOptions> check_options(const PortTypes& types, OptionValues values);
// And for those whose type is known.
Result<PortOptions> check_options(PortOptions options);

// The types and their options with defaults, for --help.
std::string port_help(const PortTypes& types);

// What every type has.
struct CommonOptions {
  bool reads = true;   // bytes come from the peer
  bool writes = true;  // bytes go to the peer
  bool always_open = false;
  std::optional<Nanos> timeout = {};  // of a blocking call; none: it waits for ever
};

// A port to be made: what was written, typed and checked.
class PortSpec {
 public:
  // Errc::usage where options contradict each other.
  static Result<PortSpec> read(PortOptions written);

  [[nodiscard]] const PortType& type() const { return *written_.type; }
  [[nodiscard]] const PortOptions& written() const { return written_; }
  [[nodiscard]] std::string name() const { return written_.name(); }
  [[nodiscard]] std::string spelled() const { return written_.spelled(); }
  [[nodiscard]] const CommonOptions& common() const { return common_; }
  CommonOptions& common() { return common_; }
  // The struct of its type; null where it is another type's.
  template <class Options>
  [[nodiscard]] const Options* get() const {
    return options_.get<Options>();
  }
  // With what no text says (callbacks, say). `options` is of its type.
  template <class Options>
  void set(Options options) {
    options_.set(std::move(options));
  }

 private:
  PortSpec(PortOptions written, CommonOptions common, TypedOptions options)
      : written_(std::move(written)), common_(common), options_(std::move(options)) {}

  PortOptions written_;
  CommonOptions common_;
  TypedOptions options_;
};

// The options of a serial line, for types that have one, and what they say.
std::vector<OptionSpec> line_setting_options();
LineSettings line_settings(const PortOptions& written);

// Both: text to spec.
Result<PortSpec> parse_port(const PortTypes& types, std::string_view spec);

// A PortType's `make` out of a function of the typed options.
template <class Options, class Make>
auto makes(Make make) {
  return [make](const PortContext& context, const PortSpec& spec,
                const std::string&) -> Result<std::unique_ptr<Port>> {
    return std::unique_ptr<Port>(make(context, spec.common(), *spec.get<Options>()));
  };
}

// And its `read`: what gives a Result<Options> gives a Result<TypedOptions>.
template <class Read>
auto reads(Read read) {
  return [read](const PortOptions& written) -> Result<TypedOptions> {
    auto options = read(written);
    if (!options) return options.error();
    return TypedOptions::of(std::move(*options));
  };
}

// The type with a wrapper for its ports: the wrapper's options besides the type's, which `read` makes a
// struct of its own (a Result<std::optional<Options>>; none: no wrapper), and `around`, which gives the
// wrapper of a port (context, port, Options). Given to each plain type before its recording type is made, so
// that a tape has the line as the wrapper makes it.
template <class Options, class Read, class Around>
PortType wrapped(PortType type, std::span<const OptionSpec> options, Read read, Around around) {
  type.options.insert(type.options.end(), options.begin(), options.end());
  type.read = [plain = std::move(type.read), read](const PortOptions& written) -> Result<TypedOptions> {
    Result<TypedOptions> typed = plain(written);
    if (!typed) return typed;
    Result<std::optional<Options>> own = read(written);
    if (!own) return own.error();
    if (*own) typed->set(std::move(**own));
    return typed;
  };
  type.make = [plain = std::move(type.make), around](const PortContext& context, const PortSpec& spec,
                                                     const std::string& peer) {
    Result<std::unique_ptr<Port>> port = plain(context, spec, peer);
    const Options* const own = spec.get<Options>();
    if (port && own != nullptr) *port = around(context, std::move(*port), *own);
    return port;
  };
  return type;
}

}  // namespace porttape
