#include <fmt/format.h>
#include <string>
#include <string_view>

#include "libport/base/utf8.hpp"
#include "libport/rules/framing.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {
namespace {

bool is_plain(std::string_view text) {
  for (const char character : text) {
    if (static_cast<unsigned char>(character) < 0x20 || static_cast<unsigned char>(character) > 0x7e)
      return false;
  }
  return true;
}

// In single quotes, where nothing is escaped, if that can be.
std::string toml_text(std::string_view text) {
  if (is_plain(text) && text.find('\'') == std::string_view::npos) return "'" + std::string(text) + "'";
  std::string out = "\"";
  for (const char character : text) {
    const auto code = static_cast<unsigned char>(character);
    if (character == '"' || character == '\\') {
      out += '\\';
      out += character;
    } else if (code < 0x20 || code == 0x7f) {
      out += fmt::format("\\u{:04X}", code);
    } else {
      out += character;
    }
  }
  return out + '"';
}

class Writer {
 public:
  void table(std::string_view name) { text_ += fmt::format("\n[[{}]]\n", name); }
  void text(std::string_view key, std::string_view value) {
    if (!value.empty()) text_ += fmt::format("{} = {}\n", key, toml_text(value));
  }
  template <class Number>
  void number(std::string_view key, Number value) {
    text_ += fmt::format("{} = {}\n", key, value);
  }
  // As text where it is plain, else in hexadecimal.
  void bytes(std::string_view key, const Bytes& value) {
    if (value.empty()) return;
    bool shows = true;
    for (const Byte byte : value)
      shows = shows && (byte == '\r' || byte == '\n' || (byte >= 0x20 && byte < 0x7f));
    if (!shows) return text(fmt::format("{}_hex", key), to_hex(value));
    std::string out = "\"";
    for (const Byte byte : value) {
      const std::string_view escape = short_escape(byte);
      out += escape.empty() ? std::string(1, static_cast<char>(byte)) : std::string(escape);
    }
    text_ += fmt::format("{} = {}\"\n", key, out);
  }
  void line(std::string_view line) { text_ += fmt::format("{}\n", line); }

  [[nodiscard]] std::string take() { return std::move(text_); }

 private:
  std::string text_ = "format = 'porttape-rules'\nversion = 1\n";
};

std::string inline_place(const Place& place) {
  if (place.by == Place::By::column) {
    return fmt::format("{{ column = {}, separator = {} }}", place.column, toml_text(place.separator));
  }
  if (place.by == Place::By::capture) return fmt::format("{{ capture = {} }}", toml_text(place.capture));
  std::string out = fmt::format("{{ at = {}", place.at);
  if (place.size) out += fmt::format(", size = {}", *place.size);
  if (place.to) out += fmt::format(", to = {}", *place.to);
  return out + " }";
}

void write_place(Writer& out, const Place& place) {
  if (place.by == Place::By::column) {
    out.number("column", place.column);
    if (place.separator != ",") out.text("separator", place.separator);
  } else if (place.by == Place::By::capture) {
    out.text("capture", place.capture);
  } else {
    out.number("at", place.at);
    if (place.size) out.number("size", *place.size);
    if (place.to) out.number("to", *place.to);
  }
}

std::string_view name_of(ByteOrder order) { return order == ByteOrder::big ? "big" : "little"; }

std::string_view name_of(NumberType type) {
  switch (type) {
    case NumberType::unsigned_:
      return "unsigned";
    case NumberType::signed_:
      return "signed";
    case NumberType::decimal:
      return "decimal";
    case NumberType::hex:
      break;
  }
  return "hex";
}

std::string inline_checksum(const ChecksumField& field) {
  std::string out =
      fmt::format("checksum = {{ kind = {}, at = {}, from = {}", toml_text(field.kind), field.at, field.from);
  if (field.to) out += fmt::format(", to = {}", *field.to);
  if (field.order != ByteOrder::big) out += ", order = 'little'";
  if (field.hex) out += ", hex = true";
  if (field.of_hex) out += ", of_hex = true";
  if (field.mavlink_extra) out += ", mavlink_extra = true";
  return out + " }";
}

void write_kind(Writer& out, const FrameFormat& format) {
  using Kind = FrameFormat::Kind;
  switch (format.kind) {
    case Kind::delimited:
      out.text("kind", "delimited");
      out.bytes("end", format.end);
      if (format.trailer > 0) out.number("trailer", format.trailer);
      break;
    case Kind::length: {
      out.text("kind", "length");
      const LengthField& length = format.length;
      std::string line = fmt::format("length = {{ at = {}, size = {}, order = '{}', adds = {}", length.at,
                                     length.size, name_of(length.order), length.adds);
      if (length.signed_at) line += fmt::format(", signed_at = {}", *length.signed_at);
      out.line(line + " }");
      break;
    }
    case Kind::fixed:
      out.text("kind", "fixed");
      out.number("size", format.size);
      break;
    case Kind::idle:
      out.text("kind", "idle");
      out.line(fmt::format("idle_ms = {}", static_cast<double>(format.idle.count()) / 1e3));
      break;
  }
}

void write(Writer& out, const FrameFormat& format) {
  out.table("frame");
  out.text("name", format.name.raw());
  const bool own = format.protocol.empty();
  const std::size_t usual = own ? FrameFormat().longest : protocol_formats(format.protocol).front().longest;
  if (format.longest != usual) out.number("longest", format.longest);
  if (!own) return out.text("protocol", format.protocol);
  write_kind(out, format);
  out.bytes("start", format.start);
  if (format.checksum) out.line(inline_checksum(*format.checksum));
}

void write(Writer& out, const Rule& rule) {
  using Kind = Rule::Kind;
  out.table("rule");
  out.text("name", rule.name.raw());
  out.text("frame", rule.frame);
  out.text("when", rule.when);
  if (rule.kind == Kind::frame) {
    if (rule.optional) out.line("optional = true");
    if (rule.with_answer) out.line(fmt::format("with_answer = {}", *rule.with_answer));
    if (rule.repeated) out.line("repeated = true");
    return;
  }
  write_place(out, rule.place);
  if (rule.kind == Kind::ignore) out.line("ignore = true");
  if (rule.kind == Kind::mask) out.text("mask", to_hex(rule.mask));
  if (rule.kind == Kind::regex) out.text("regex", rule.regex);
  if (rule.kind == Kind::range) out.line(fmt::format("range = [{}, {}]", rule.least, rule.most));
  if (rule.kind == Kind::counter) {
    out.line(rule.counter.modulo > 0 ? fmt::format("counter = {{ modulo = {} }}", rule.counter.modulo)
                                     : "counter = true");
  }
  if (rule.kind == Kind::range || rule.kind == Kind::counter) {
    out.text("type", name_of(rule.type));
    if (rule.order != ByteOrder::big) out.text("order", name_of(rule.order));
  }
  if (rule.length) out.line(fmt::format("length = [{}, {}]", rule.length->least, rule.length->most));
}

void write(Writer& out, const ReplyTemplate& reply) {
  out.table("reply");
  out.text("name", reply.name.raw());
  out.text("frame", reply.frame);
  out.text("when", reply.when);
  out.line("from = " + inline_place(reply.from));
  out.text("answer_frame", reply.answer_frame);
  out.text("answer", reply.answer);
  out.line("to = " + inline_place(reply.to));
}

void write_secret(Writer& out, const RedactRule& rule) {
  using Kind = RedactRule::Kind;
  if (rule.kind == Kind::place) {
    out.text("frame", rule.frame);
    out.text("when", rule.when);
    return write_place(out, rule.place);
  }
  if (rule.kind == Kind::range) {
    out.number("offset", rule.offset);
    return out.number("size", rule.size);
  }
  out.text("pattern", rule.pattern);
  if (rule.kind == Kind::pattern && rule.longest != RedactRule().longest) out.number("longest", rule.longest);
  out.text("text_hex", to_hex(rule.text));
  if (!rule.events) out.line("events = false");
}

void write(Writer& out, const RedactRule& rule) {
  out.table("redact");
  out.text("name", rule.name.raw());
  if (rule.direction) out.text("dir", *rule.direction == Direction::read ? "r" : "w");
  write_secret(out, rule);
  switch (rule.filler) {
    case FillerKind::like:
      break;
    case FillerKind::digits:
      return out.text("filler", "digits");
    case FillerKind::letters:
      return out.text("filler", "letters");
    case FillerKind::hex:
      return out.text("filler", "hex");
    case FillerKind::bytes:
      return out.text("filler", "bytes");
    case FillerKind::constant:
      return out.text("with_hex", to_hex(rule.with));
  }
}

}  // namespace

std::string to_toml(const RuleSet& rules) {
  Writer out;
  const FrameFormat* before = nullptr;
  for (const FrameFormat& format : rules.frames) {
    // One table of a protocol may be several formats.
    const bool same = before != nullptr && !format.protocol.empty() && before->protocol == format.protocol &&
                      before->name == format.name;
    if (!same) write(out, format);
    before = &format;
  }
  for (const Rule& rule : rules.rules) write(out, rule);
  for (const ReplyTemplate& reply : rules.replies) write(out, reply);
  for (const RedactRule& rule : rules.redactions) write(out, rule);
  return out.take();
}

}  // namespace porttape
