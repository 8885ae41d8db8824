#include "libport/tape/event_file.hpp"

#include <cstring>
#include <utility>
#include <variant>

#include "libport/tape/json_line.hpp"

namespace porttape {

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
  lines_ = {};
  event_ = {};
  line_ = {};
  ended_ = torn_ = false;
  error_.reset();
  if (const auto read = read_header(); !read) fail(read.error());
}

void EventFile::read_on() {
  if (!ended_ || error_) return;
  ended_ = torn_ = false;
  offset_ -= end_ - begin_;
  begin_ = end_ = 0;
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

void EventFile::pass(std::string_view line) {
  lines_.add(as_bytes(line));
  lines_.add(as_bytes("\n"));
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
    return make_error(Errc::damaged_tape, name() + " is not an events file: its first line has no end");
  }
  if (!*line) {
    ended_ = true;
    return check_unfinished();
  }
  auto header = decode_header(**line);
  if (!header) return make_error(header.error().code, name() + " is " + header.error().message);
  header_ = std::move(*header);
  header_line_ = **line;
  pass(**line);
  return {};
}

EventFile::Step EventFile::next() {
  if (ended_) return error_ ? Step::failed : Step::end;
  if (!header_) {
    if (const auto read = read_header(); !read) return fail(read.error());
    if (ended_) return Step::end;
  }
  const auto line = next_line();
  if (!line) return fail(line.error());
  if (!*line) {
    ended_ = true;
    const Result<void> unfinished = check_unfinished();
    return unfinished ? Step::end : fail(unfinished.error());
  }
  return take(**line);
}

// A killed recorder leaves the beginning of a line, and nothing that goes on behind a whole one.
Result<void> EventFile::check_unfinished() const {
  const std::string_view unread(buffer_.get() + begin_, end_ - begin_);
  if (!goes_on_behind_object(unread)) return {};
  return make_error(Errc::damaged_tape, name() + " is damaged in line " + std::to_string(line_number_ + 1) +
                                            ": something other than its end follows the line");
}

// What the line tells of itself and of those before it.
Result<void> EventFile::check(std::string_view line, const Event& event) const {
  if (Result<void> sealed = check_seal(line, event); !sealed) return sealed;
  const auto* end = std::get_if<event::End>(&event);
  if (end == nullptr || !end->events || *end->events == lines_.value()) return {};
  return make_error(Errc::damaged_tape,
                    "the lines before it are not those that were written: their xxh3 is " +
                        digest_text(lines_.value()) + ", and this line tells of " +
                        digest_text(*end->events));
}

// Makes the line the current event.
EventFile::Step EventFile::take(std::string_view line) {
  auto event = decode_event(line);
  if (!event) return fail(damage(event.error().message));
  if (event->at < event_.at) {
    return fail(damage("time goes back from " + std::to_string(to_us(event_.at)) + " to " +
                       std::to_string(to_us(event->at)) + " us"));
  }
  if (const Result<void> sound = check(line, event->what); !sound) return fail(damage(sound.error().message));
  pass(line);
  event_ = std::move(*event);
  line_ = line;
  if (const auto* told = std::get_if<event::Zero>(&event_.what)) header_->zero = told->zero;
  return Step::event;
}

std::optional<TapeHeader> header_of(const TapePaths& tape) {
  Result<std::unique_ptr<FileSource>> source = FileSource::open(tape.events);
  if (!source) return std::nullopt;
  const Result<EventFile> file = EventFile::create(std::move(*source));
  return file ? file->header() : std::nullopt;
}

}  // namespace porttape
