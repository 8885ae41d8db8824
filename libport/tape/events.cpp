#include "libport/tape/events.hpp"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <system_error>
#include <utility>

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>

namespace porttape {
namespace {

namespace json = boost::json;

// The value of a line; null where the line is no JSON object.
json::value parse_line(std::string_view line) {
  json::parse_options options;
  options.allow_invalid_utf8 = true;
  json::error_code failed;
  json::value value = json::parse({line.data(), line.size()}, failed, {}, options);
  if (failed || !value.is_object()) return nullptr;
  return value;
}

std::string text_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const json::string* text = value == nullptr ? nullptr : value->if_string();
  return text == nullptr ? std::string() : std::string(text->data(), text->size());
}

// A whole number that is not negative.
std::optional<std::int64_t> number_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const std::int64_t* number = value == nullptr ? nullptr : value->if_int64();
  if (number == nullptr || *number < 0) return std::nullopt;
  return *number;
}

const json::object* object_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  return value == nullptr ? nullptr : value->if_object();
}

// The zero that a `zero` event or the header's object tells.
std::optional<TapeZero> zero_of(const json::object* object) {
  if (object == nullptr) return std::nullopt;
  return TapeZero{text_of(*object, "wall"), number_of(*object, "monotonic_us").value_or(0),
                  text_of(*object, "boot")};
}

std::optional<std::uint64_t> digest_of(const std::string& hex) {
  std::uint64_t digest = 0;
  const auto [end, error] = std::from_chars(hex.data(), hex.data() + hex.size(), digest, 16);
  if (hex.size() != 16 || error != std::errc() || end != hex.data() + hex.size()) return std::nullopt;
  return digest;
}

std::optional<PayloadTotals> totals_of(const json::object* object) {
  if (object == nullptr) return std::nullopt;
  const auto blocks = number_of(*object, "blocks");
  const auto bytes = number_of(*object, "bytes");
  if (!blocks || !bytes) return std::nullopt;
  return PayloadTotals{static_cast<std::uint64_t>(*blocks), static_cast<std::uint64_t>(*bytes),
                       digest_of(text_of(*object, "xxh3"))};
}

TapeHeader header_of(const json::object& object) {
  TapeHeader header{text_of(object, "device"), text_of(object, "driver"), text_of(object, "created"),
                    text_of(object, "host"),   text_of(object, "tool"),   text_of(object, "id")};
  header.zero = zero_of(object_of(object, "zero"));
  const std::string transport = text_of(object, "transport");
  if (transport == "stream") header.transport = Transport::stream;
  if (transport == "datagram") header.transport = Transport::datagram;
  const std::string stamped = text_of(object, "stamped");
  if (stamped == "arrival") header.stamped = Stamped::arrival;
  if (stamped == "read") header.stamped = Stamped::read;
  if (const json::object* previous = object_of(object, "previous")) {
    header.previous = PreviousTape{text_of(*previous, "id"), text_of(*previous, "name")};
  }
  return header;
}

}  // namespace

EventFile::EventFile(std::unique_ptr<ByteSource> source)
    : source_(std::move(source)), buffer_(std::make_unique_for_overwrite<char[]>(kMaxLine)) {}

Result<EventFile> EventFile::create(std::unique_ptr<ByteSource> source) {
  EventFile file(std::move(source));
  if (const auto read = file.read_header(); !read) return read.error();
  return file;
}

void EventFile::rewind() {
  begin_ = end_ = 0;
  offset_ = line_number_ = 0;
  event_ = {};
  ended_ = torn_ = false;
  error_.reset();
  if (const auto read = read_header(); !read) fail(read.error());
}

std::optional<std::string> EventFile::torn_tail() const {
  if (!torn_) return std::nullopt;
  return name() + ": the last line (" + std::to_string(line_number_ + 1) +
         ") is unfinished and does not count";
}

Error EventFile::damage(const std::string& reason) const {
  return make_error(Errc::damaged_tape,
                    name() + " is damaged in line " + std::to_string(line_number_) + ": " + reason);
}

EventFile::Step EventFile::fail(Error error) {
  ended_ = true;
  error_ = std::move(error);
  return Step::failed;
}

// The next line without its newline; nothing at the end of the file.
Result<std::optional<std::string_view>> EventFile::next_line() {
  for (;;) {
    const std::string_view unread(buffer_.get() + begin_, end_ - begin_);
    if (const std::size_t newline = unread.find('\n'); newline != std::string_view::npos) {
      ++line_number_;
      begin_ += newline + 1;
      return std::optional(unread.substr(0, newline));
    }
    if (unread.size() == kMaxLine) {
      ++line_number_;
      return damage("longer than " + std::to_string(kMaxLine) + " bytes");
    }
    std::memmove(buffer_.get(), unread.data(), unread.size());
    begin_ = 0;
    end_ = unread.size();
    const auto got =
        source_->read_at(offset_, {reinterpret_cast<Byte*>(buffer_.get()) + end_, kMaxLine - end_});
    if (!got) return got.error();
    if (*got == 0) {
      torn_ = end_ > 0;
      return std::optional<std::string_view>{};
    }
    end_ += *got;
    offset_ += *got;
  }
}

Result<void> EventFile::read_header() {
  const auto line = next_line();
  if (!line) {
    if (line.error().code == Errc::io) return line.error();
    return make_error(Errc::not_a_tape, name() + " is not an events file: its first line has no end");
  }
  if (!*line) {
    ended_ = true;
    return {};
  }
  const json::value value = parse_line(**line);
  const json::object* object = value.if_object();
  if (object == nullptr || text_of(*object, "format") != "porttape-events") {
    return make_error(Errc::not_a_tape,
                      name() + " is not an events file: its first line is no porttape-events header");
  }
  if (const auto number = number_of(*object, "version"); number != 1) {
    return make_error(Errc::not_a_tape, name() + " is an events file of version " +
                                            (number ? std::to_string(*number) : "?") +
                                            "; this porttape reads version 1");
  }
  header_ = header_of(*object);
  return {};
}

EventFile::Step EventFile::next() {
  if (ended_) return error_ ? Step::failed : Step::end;
  const auto line = next_line();
  if (!line) return fail(line.error());
  if (!*line) {
    ended_ = true;
    return Step::end;
  }
  const std::string reason = take(**line);
  return reason.empty() ? Step::event : fail(damage(reason));
}

// Makes the line the current event; gives what is wrong with it, or nothing.
std::string EventFile::take(std::string_view line) {
  const json::value value = parse_line(line);
  const json::object* object = value.if_object();
  if (object == nullptr) return "not a JSON object";
  const auto at = number_of(*object, "t_us");
  if (!at) return "no t_us, or it is not a number of microseconds";
  if (tape_time_us(*at) < event_.at) {
    return "time goes back from " + std::to_string(to_us(event_.at)) + " to " + std::to_string(*at) + " us";
  }
  std::string kind = text_of(*object, "event");
  if (kind.empty()) return "no event";
  event_.at = tape_time_us(*at);
  event_.kind = std::move(kind);
  event_.text = text_of(*object, "text");
  event_.why = text_of(*object, "why");
  event_.bytes = static_cast<std::uint64_t>(number_of(*object, "bytes").value_or(0));
  event_.from = tape_time_us(number_of(*object, "from_us").value_or(0));
  const json::value* hung_up = object->if_contains("hung_up");
  event_.hung_up = hung_up != nullptr && hung_up->is_bool() && hung_up->get_bool();
  const bool ends = event_.kind == "end";
  event_.read = ends ? totals_of(object_of(*object, "read")) : std::nullopt;
  event_.write = ends ? totals_of(object_of(*object, "write")) : std::nullopt;
  if (event_.kind == "zero") header_->zero = zero_of(object);
  event_.line = line;
  return {};
}

}  // namespace porttape
