#include <algorithm>
#include <array>
#include <cstring>
#include <fmt/format.h>
#include <map>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/formats/sr_format.hpp"
#include "libport/formats/sr_metadata.hpp"
#include "libport/formats/uart_listener.hpp"
#include "libport/formats/zip_file.hpp"
#include "libport/line/line_settings_text.hpp"

namespace porttape {
namespace {

constexpr std::string_view kZipMagic = "PK\x03\x04";
constexpr std::size_t kMostMetadata = std::size_t{1} << 20U;
constexpr std::size_t kEdgesLookedAt = 4096;  // for the speed

// Speeds that lines have; of what was measured the next one is taken.
constexpr std::array kUsualBauds = {300U,     600U,     1'200U,   2'400U,     4'800U,     9'600U,
                                    19'200U,  38'400U,  57'600U,  115'200U,   230'400U,   250'000U,
                                    460'800U, 500'000U, 921'600U, 1'000'000U, 2'000'000U, 3'000'000U};

class SrImport {
 public:
  SrImport(Evidence& from, ImportTape& to) : from_(from), to_(to), zip_(from) {}

  Result<std::optional<TapeTime>> run(const ConvertProgress& progress) {
    const auto head = from_.peek(kZipMagic.size());
    if (!head) return head.error();
    if (as_text(*head) != kZipMagic) return none("it is no zip");
    if (Result<void> known = read_options(); !known) return known.error();
    for (;;) {
      const auto name = zip_.next();
      if (!name) return name.error();
      if (!*name) break;
      if (Result<void> taken = take(**name, progress); !taken) return taken.error();
    }
    if (!metadata_) return none("it has no file `metadata`");
    if (Result<void> begun = listen(); !begun) return begun.error();
    if (Result<void> finished = listener_->finish(sample_); !finished) return finished.error();
    return std::optional(std::max(to_.latest(), listener_->time(sample_)));
  }

 private:
  struct Edge {
    std::uint64_t at = 0;
    Direction way = Direction::read;
    bool high = false;
  };
  struct Channel {
    Direction way = Direction::read;
    unsigned number = 0;
    bool high = true;
  };

  [[nodiscard]] Error none(std::string_view why) const {
    return make_error(Errc::not_a_tape, fmt::format("{} is no session of sigrok: {}", from_.name(), why));
  }

  Result<void> read_options() {
    Result<UartOptions> options = UartOptions::parse(to_.options().device.value_or(""));
    if (!options) return options.error();
    options_ = std::move(*options);
    options_.line.baud = to_.options().bytes_at;
    return {};
  }

  Result<void> take(const std::string& name, const ConvertProgress& progress) {
    if (name == "version") return check_version();
    if (name == "metadata") return read_metadata();
    const bool is_logic = name.starts_with("logic-");
    if (is_logic && !metadata_)
      return from_.error_at(from_.offset(),
                            "samples before the `metadata` that tells of them; save it with PulseView");
    if (!metadata_ || (name != metadata_->capture && !name.starts_with(metadata_->capture + "-"))) return {};
    for (;;) {
      const auto piece = zip_.read();
      if (!piece) return piece.error();
      if (piece->empty()) return {};
      if (Result<void> taken = take_samples(*piece); !taken) return taken;
      if (progress) progress(from_.offset());
    }
  }

  Result<void> check_version() {
    const auto text = zip_.read();
    if (!text) return text.error();
    const std::string_view version = as_text(*text).substr(0, 8);
    if (version.starts_with('1') || version.starts_with('2')) return {};
    return make_error(Errc::not_a_tape, fmt::format("{} is a session of version {}; 1 and 2 are read",
                                                    from_.name(), in_quotes(version)));
  }

  Result<void> read_metadata() {
    std::string text;
    for (;;) {
      const auto piece = zip_.read();
      if (!piece) return piece.error();
      if (piece->empty()) break;
      text += as_text(*piece);
      if (text.size() > kMostMetadata) return none("its `metadata` is over 1 MiB");
    }
    const Result<SrMetadata> metadata = SrMetadata::parse(text);
    if (!metadata) return from_.error_at(from_.offset(), metadata.error().message);
    metadata_ = *metadata;
    return choose_channels();
  }

  Result<void> choose_channels() {
    const bool named = !options_.rx.empty() || !options_.tx.empty();
    for (const auto& [way, name, usual] :
         {std::tuple(Direction::read, options_.rx, "rx"), std::tuple(Direction::write, options_.tx, "tx")}) {
      const auto number = metadata_->channel(named ? name : usual);
      if (number) channels_.push_back({way, *number, true});
      if (!number && !name.empty())
        return usage_error(fmt::format("option 'device': there is no channel {}; there are {}",
                                       in_quotes(name), fmt::join(metadata_->channels, ", ")));
    }
    if (!channels_.empty()) return {};
    for (unsigned number = 0; number < metadata_->channels.size() && channels_.size() < 2; ++number) {
      if (metadata_->channels[number].empty() || number >= metadata_->unit_size * 8) continue;
      channels_.push_back({channels_.empty() ? Direction::read : Direction::write, number, true});
      to_.guessed(fmt::format("channel {} is what the {}; --device rx=NAME,tx=NAME takes others",
                              in_quotes(metadata_->channels[number]),
                              channels_.size() == 1 ? "driver reads" : "driver writes"));
    }
    return channels_.empty() ? Result<void>(none("it has no logic channels")) : Result<void>();
  }

  Result<void> take_samples(ByteView piece) {
    const std::size_t size = metadata_->unit_size;
    // Of a sample that is in two pieces.
    while (!torn_.empty() && torn_.size() < size && !piece.empty()) {
      torn_.push_back(piece.front());
      piece = piece.subspan(1);
    }
    if (torn_.size() == size) {
      if (Result<void> taken = take_sample(torn_); !taken) return taken;
      torn_.clear();
    }
    const std::size_t whole = piece.size() / size * size;
    for (std::size_t at = 0; at < whole;) {
      const std::size_t same = at == 0 || size != 1 ? 0 : as_before(piece.subspan(at));
      sample_ += same;
      at += same;
      if (at == whole) break;
      if (Result<void> taken = take_sample(piece.subspan(at, size)); !taken) return taken;
      at += size;
    }
    torn_.insert(torn_.end(), piece.begin() + static_cast<std::ptrdiff_t>(whole), piece.end());
    return listener_ ? listener_->advance(sample_) : Result<void>();
  }

  // How many samples of a byte are as the last one.
  [[nodiscard]] std::size_t as_before(ByteView piece) const {
    const std::uint64_t all = std::uint64_t{last_} * 0x0101010101010101U;
    std::size_t at = 0;
    for (; at + sizeof all <= piece.size(); at += sizeof all) {
      std::uint64_t these = 0;
      std::memcpy(&these, piece.data() + at, sizeof these);
      if (these != all) break;
    }
    while (at < piece.size() && piece[at] == last_) ++at;
    return at;
  }

  Result<void> take_sample(ByteView unit) {
    last_ = unit.front();
    for (Channel& channel : channels_) {
      const bool bit = (unsigned{unit[channel.number / 8]} >> channel.number % 8 & 1U) != 0;
      const bool high = bit != options_.inverted;
      if (high == std::exchange(channel.high, high)) continue;
      if (Result<void> taken = edge({sample_, channel.way, high}); !taken) return taken;
    }
    ++sample_;
    return {};
  }

  Result<void> edge(const Edge& edge) {
    if (listener_) return listener_->level(edge.way, edge.at, edge.high);
    edges_.push_back(edge);
    const bool told = options_.line.over(metadata_->line).baud.has_value();
    return told || edges_.size() == kEdgesLookedAt ? listen() : Result<void>();
  }

  // Begins with what was kept back until the speed was known.
  Result<void> listen() {
    if (listener_) return {};
    LineSettings line = options_.line.over(metadata_->line).over(LineSettings{});
    if (!options_.line.over(metadata_->line).baud) {
      line.baud = measured();
      if (line.baud == 0)
        return usage_error(from_.name() + ": the line's speed cannot be seen; say it by --bytes-at BAUD");
      to_.guessed(fmt::format("the line's speed is {}, by its shortest pulse; --bytes-at BAUD takes another",
                              line.baud));
    }
    if (line.baud == 0 || metadata_->rate / line.baud < 2)
      return usage_error(fmt::format("{}: {} samples a second are too few for {} bit/s", from_.name(),
                                     metadata_->rate, line.baud));
    listener_.emplace(to_, metadata_->rate, line, metadata_->lead);
    if (Result<void> put = to_.event(TapeTime{}, event::Open{}); !put) return put;
    const SeenSettings seen{
        .baud = line.baud, .data_bits = line.data_bits, .parity = line.parity, .stop_bits = line.stop_bits};
    if (Result<void> put = to_.event(TapeTime{}, event::Settings{Side::device, seen, {}}); !put) return put;
    for (const Edge& each : std::exchange(edges_, {})) {
      if (Result<void> taken = listener_->level(each.way, each.at, each.high); !taken) return taken;
    }
    return {};
  }

  // By the shortest pulse; 0: there is none.
  [[nodiscard]] unsigned measured() const {
    std::uint64_t shortest = 0;
    std::map<Direction, std::uint64_t> fell;
    for (const Edge& each : edges_) {
      const auto begun = fell.find(each.way);
      if (begun != fell.end() && (shortest == 0 || each.at - begun->second < shortest))
        shortest = each.at - begun->second;
      fell[each.way] = each.at;
    }
    if (shortest == 0) return 0;
    const double baud = static_cast<double>(metadata_->rate) / static_cast<double>(shortest);
    const auto* const near = std::ranges::min_element(
        kUsualBauds, {}, [&](unsigned usual) { return std::max(usual / baud, baud / usual); });
    return *near;
  }

  Evidence& from_;
  ImportTape& to_;
  ZipReader zip_;
  UartOptions options_;
  std::optional<SrMetadata> metadata_;
  std::vector<Channel> channels_;
  std::vector<Edge> edges_;
  std::optional<UartListener> listener_;
  std::uint64_t sample_ = 0;
  Byte last_ = 0;
  Bytes torn_;
};

}  // namespace

Result<std::optional<TapeTime>> import_sr(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return SrImport(from, to).run(progress);
}

int detect_sr(std::string_view head) {
  // A zip whose first file is `version`, as sigrok writes them.
  return head.starts_with(kZipMagic) && head.size() > 37 && head.substr(30, 7) == "version" ? 100 : 0;
}

}  // namespace porttape
