#include "libport/session/session_news.hpp"

namespace porttape {

void SessionNews::device_failed(const LineDown& down, spdlog::level::level_enum level,
                                std::string_view then) {
  const bool news = failures_.failed(context_.loop->now(), down.error.message);
  tell_failures();
  context_.log->log(news ? level : spdlog::level::debug, "{}{}", down.error.message, then);
}

void SessionNews::device_works() {
  if (!failures_.in_a_row()) return;
  failures_.worked();
  context_.log->info("{}: works again", device_.name());
  tell_failures();
  tell_dropped();
}

void SessionNews::tell_failures() {
  if (const auto count = failures_.take_untold())
    context_.log->warn("{}: it had failed {} more times in the same way", device_.name(), *count);
}

void SessionNews::dropped(std::uint64_t bytes, std::string_view why) {
  dropped_bytes_ += bytes;
  untold_.add(bytes, why);
}

void SessionNews::dropped_by_driver(std::uint64_t bytes, std::string_view why) {
  dropped(bytes, why);
  unnoted_.add(bytes, why);
}

void SessionNews::note_gap() {
  Recorder* const recorder = device_.recorder();
  if (const auto sum = unnoted_.take(); sum && recorder != nullptr) recorder->note_gap(sum->bytes, sum->why);
}

void SessionNews::tell_dropped() {
  if (failures_.repeats()) return;  // all together later
  if (const auto sum = untold_.take())
    context_.log->warn("{} bytes reached nobody (the last because {})", sum->bytes, sum->why);
}

void SessionNews::end() {
  failures_.worked();
  tell_failures();
  tell_dropped();
}

}  // namespace porttape
