#include <algorithm>
#include <array>
#include <fmt/format.h>

#include "libport/formats/sr_format.hpp"
#include "libport/formats/uart_decoder.hpp"
#include "libport/formats/uart_waveform.hpp"
#include "libport/formats/zip_file.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/tape/part_writer.hpp"

namespace porttape {
namespace {

constexpr unsigned kSamplesOfBit = 8;
constexpr unsigned kUsualBaud = 115'200;
constexpr unsigned kFastestBaud = 12'000'000;
constexpr unsigned kReadLine = 0;
constexpr unsigned kWriteLine = 1;
constexpr std::uint64_t kMostSamples = std::uint64_t{1} << 38U;
// A block that was read ends at its time, where the line was free for so many bytes before.
constexpr std::uint64_t kBytesBefore = 64;
constexpr std::uint64_t kTail = std::uint64_t{32} * kSamplesOfBit;  // behind its end
constexpr std::uint64_t kLead = kBytesBefore * 12 * kSamplesOfBit;  // samples before the tape's zero

// What is to be known of a tape before the first sample.
struct SrPlan {
  unsigned baud = 0;  // the fastest
  bool guessed = false;
  std::uint64_t rate = 0;  // samples in a second
  TapeTime end{};
  std::vector<std::string> lost;
};

Result<SrPlan> plan_of(TapeReader& from, std::optional<unsigned> bytes_at) {
  SrPlan plan;
  bool has_events = false;
  for (;;) {
    const auto next = from.next();
    if (!next) return next.error();
    if (!*next) break;
    const Record& record = **next;
    plan.end = record.at;
    if (record.event == nullptr) continue;
    const auto* const settings = std::get_if<event::Settings>(record.event);
    if (settings != nullptr && settings->line.baud && *settings->line.baud <= kFastestBaud)
      plan.baud = std::max(plan.baud, *settings->line.baud);
    const bool shown = settings != nullptr || std::holds_alternative<event::Break>(*record.event);
    has_events |= !shown && !std::holds_alternative<event::End>(*record.event);
  }
  if (Result<void> again = from.rewind(); !again) return again.error();
  plan.guessed = plan.baud == 0;
  if (plan.guessed) plan.baud = std::min(bytes_at.value_or(kUsualBaud), kFastestBaud);
  plan.rate = std::uint64_t{plan.baud} * kSamplesOfBit;
  if (static_cast<std::uint64_t>(to_us(plan.end)) / 1'000'000 >= kMostSamples / plan.rate)
    return usage_error(
        fmt::format("{} s at {} samples a second are too many samples; cut the part out that "
                    "matters: porttape cut --from S --to S",
                    to_us(plan.end) / 1'000'000, plan.rate));
  plan.lost.emplace_back("blocks, and times where the bytes take longer than the tape says");
  if (has_events) plan.lost.emplace_back("events other than breaks");
  if (plan.guessed && !bytes_at)
    plan.lost.push_back(fmt::format(
        "the line's speed, which the tape does not tell; {} is taken (--bytes-at BAUD)", plan.baud));
  return plan;
}

class SrExport {
 public:
  SrExport(NewFile& to, const SrPlan& plan)
      : zip_(to), plan_(plan), waveform_(2, [this](ByteView chunk) { return add_chunk(chunk); }) {
    format_.line.baud = plan.baud;
    format_.samples_per_bit = kSamplesOfBit;
  }

  Result<void> begin(const SeenSettings& first) {
    take(first);
    if (Result<void> added = zip_.add("version", as_bytes("2")); !added) return added;
    const std::string metadata = fmt::format(
        "[global]\nsigrok version=0.5.2\n\n"
        "[device 1]\ncapturefile=logic-1\ntotal probes=2\nsamplerate={} Hz\ntotal analog=0\n"
        "probe1=rx\nprobe2=tx\nunitsize=1\n\n"
        "[porttape]\nlead={}\nbaud={}\ndatabits={}\nparity={}\nstopbits={}\n",
        plan_.rate, kLead, format_.line.baud, format_.line.data_bits, to_string(format_.line.parity),
        format_.line.stop_bits);
    return zip_.add("metadata", as_bytes(metadata));
  }

  Result<void> add(const Record& record) {
    const std::uint64_t at = sample(record.at);
    const std::uint64_t before = kBytesBefore * 12 * static_cast<std::uint64_t>(format_.samples_per_bit + 1);
    std::uint64_t settled = at - std::min(at, before);
    for (const auto& begun : breaks_) {
      if (begun) settled = std::min(settled, *begun);
    }
    if (Result<void> advanced = waveform_.advance(settled); !advanced) return advanced;
    if (record.event != nullptr) {
      event(*record.event, at);
      return {};
    }
    return bytes(record, at);
  }

  Result<void> finish() {
    const std::uint64_t end = sample(plan_.end);
    for (const unsigned line : {kReadLine, kWriteLine}) end_break(line, end);
    if (Result<void> drawn = waveform_.finish(end + kTail); !drawn) return drawn;
    return zip_.finish();
  }

 private:
  [[nodiscard]] std::uint64_t sample(TapeTime at) const {
    const auto us = static_cast<std::uint64_t>(to_us(at));
    return kLead + us / 1'000'000 * plan_.rate + us % 1'000'000 * plan_.rate / 1'000'000;
  }

  void take(const SeenSettings& seen) {
    format_.line = seen.over(format_.line);
    if (format_.line.baud == 0 || format_.line.baud > plan_.baud) format_.line.baud = plan_.baud;
    format_.samples_per_bit = static_cast<double>(plan_.rate) / format_.line.baud;
  }

  void event(const Event& event, std::uint64_t at) {
    if (const auto* const settings = std::get_if<event::Settings>(&event)) take(settings->line);
    const auto* const broken = std::get_if<event::Break>(&event);
    if (broken == nullptr || !broken->on) return;
    const unsigned line = broken->by == Side::device ? kReadLine : kWriteLine;
    if (!*broken->on) {
      end_break(line, at);
    } else if (!breaks_.at(line)) {
      breaks_.at(line) = at;
    }
  }

  void end_break(unsigned line, std::uint64_t end) {
    auto& begun = breaks_.at(line);
    if (begun) waveform_.low(line, *begun, end);
    begun.reset();
  }

  Result<void> bytes(const Record& record, std::uint64_t at) {
    const bool is_read = record.kind == RecordKind::read;
    const unsigned line = is_read ? kReadLine : kWriteLine;
    if (is_read && record.piece_offset == 0) {
      const auto size = static_cast<double>(std::min<std::uint64_t>(record.block_length, kBytesBefore));
      const auto took = static_cast<std::uint64_t>(size * uart_bits(format_.line) * format_.samples_per_bit);
      // A falling edge needs a high line before it.
      at = std::max(at - std::min(at, took), std::uint64_t{kSamplesOfBit});
    }
    for (const Byte byte : record.data) {
      if (waveform_.byte(line, at, byte, format_)) continue;
      // The line is far behind the tape: what it was given is written before it is given more.
      if (Result<void> advanced = waveform_.advance(waveform_.free_at(line)); !advanced) return advanced;
      waveform_.byte(line, at, byte, format_);
    }
    return {};
  }

  Result<void> add_chunk(ByteView chunk) { return zip_.add(fmt::format("logic-1-{}", ++chunks_), chunk); }

  ZipWriter zip_;
  const SrPlan& plan_;
  UartWaveform waveform_;
  UartWaveform::Format format_;
  std::array<std::optional<std::uint64_t>, 2> breaks_;
  std::uint64_t chunks_ = 0;
};

// The settings that the tape begins with.
Result<SeenSettings> first_settings(TapeReader& from) {
  SeenSettings first;
  for (;;) {
    const auto next = from.next();
    if (!next) return next.error();
    if (!*next || (*next)->event == nullptr) break;
    if (const auto* const settings = std::get_if<event::Settings>((*next)->event))
      first = settings->line.over(first);
  }
  if (Result<void> again = from.rewind(); !again) return again.error();
  return first;
}

}  // namespace

Result<std::vector<std::string>> export_sr_at(TapeReader& from, NewFile& to, std::optional<unsigned> bytes_at,
                                              const ConvertProgress& progress) {
  const Result<SrPlan> plan = plan_of(from, bytes_at);
  if (!plan) return plan.error();
  const Result<SeenSettings> first = first_settings(from);
  if (!first) return first.error();
  SrExport out(to, *plan);
  if (Result<void> begun = out.begin(*first); !begun) return begun.error();
  std::uint64_t bytes = 0;
  for (;;) {
    const auto next = from.next();
    if (!next) return next.error();
    if (!*next) break;
    if (Result<void> added = out.add(**next); !added) return added.error();
    if (progress) progress(bytes += bytes_in_file(**next));
  }
  if (Result<void> finished = out.finish(); !finished) return finished.error();
  return plan->lost;
}

Result<std::vector<std::string>> export_sr(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  return export_sr_at(from, to, std::nullopt, progress);
}

}  // namespace porttape
