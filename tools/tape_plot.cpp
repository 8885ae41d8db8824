#include "tools/tape_plot.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <iterator>
#include <variant>

#include "libport/base/xml_text.hpp"
#include "libport/tape/event.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

constexpr double kWidth = 1220;
constexpr double kLeft = 90;
constexpr double kRight = 1180;
constexpr double kAxis = 170;  // of the traffic, reads above and writes below
constexpr double kHalf = 70;   // of its height
constexpr double kRateTop = 310;
constexpr double kRateBottom = 420;
constexpr double kLatencyTop = 510;
constexpr double kLatencyBottom = 620;
constexpr double kHeight = 670;

// Colours by name twice, since not all that draws SVG knows variables.
constexpr std::string_view kStyle = R"(
  text { fill: #1b1f24; font: 12px sans-serif }
  .title { font-size: 18px; font-weight: bold } .head { font-weight: bold } .end { text-anchor: end } .middle { text-anchor: middle }
  .paper { fill: #fff } .faint { fill: #6a737d } .read { fill: #0969da } .write { fill: #bc4c00 } .bad { fill: #cf222e }
  .axis, .close { stroke: #6a737d; fill: none } .read-line { stroke: #0969da; fill: none } .write-line { stroke: #bc4c00; fill: none }
  .open { stroke: #1a7f37 } .lost { stroke: #cf222e; stroke-width: 2 } .mark { stroke: #8250df } .other, .median { stroke: #1b1f24 }
  .gap { fill: #cf222e; opacity: 0.25 } .median { stroke-dasharray: 4 3 }
  @media (prefers-color-scheme: dark) {
    text { fill: #e6edf3 }
    .paper { fill: #0d1117 } .faint { fill: #8d96a0 } .read { fill: #58a6ff } .write { fill: #f0883e } .bad { fill: #ff7b72 }
    .axis, .close { stroke: #8d96a0 } .read-line { stroke: #58a6ff } .write-line { stroke: #f0883e }
    .open { stroke: #3fb950 } .lost { stroke: #ff7b72 } .mark { stroke: #d2a8ff } .other, .median { stroke: #e6edf3 }
    .gap { fill: #ff7b72 }
  }
)";

// Three digits that count, with their unit: "4.13 ms".
std::string scaled(double value, const std::vector<std::pair<double, std::string_view>>& units) {
  auto unit = units.front();
  for (const auto& next : units) {
    if (value >= next.first) unit = next;
  }
  return fmt::format("{:.3g} {}", value / unit.first, unit.second);
}

std::string time_text(double us) { return scaled(us, {{1, "us"}, {1e3, "ms"}, {1e6, "s"}}); }
std::string size_text(double bytes) {
  return scaled(bytes, {{1, "B"}, {1e3, "kB"}, {1e6, "MB"}, {1e9, "GB"}});
}

// 1, 2 or 5 times a power of ten: some eight of them fit.
double step_of(double range) {
  const double rough = range / 8;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough) return factor * power;
  }
  return 10 * power;
}

// Microseconds at the time axis: as many decimals as the step needs.
std::string tick_text(double us, double step_us) {
  const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step_us / 1e6))));
  return fmt::format("{:.{}f}", us / 1e6, decimals);
}

std::string_view look_of(const Event& event) {
  if (std::holds_alternative<event::Open>(event)) return "open";
  if (std::holds_alternative<event::Close>(event)) return "close";
  if (std::holds_alternative<event::DeviceLost>(event)) return "lost";
  if (std::holds_alternative<event::Mark>(event)) return "mark";
  return "other";
}

}  // namespace

void TapePlot::add(const Record& record) {
  end_us_ = std::max(end_us_, to_us(record.at));
  if (record.kind == RecordKind::read || record.kind == RecordKind::write) {
    add_block(record);
  } else {
    add_event(record);
  }
}

TapePlot::Column& TapePlot::column_of(TapeTime at) {
  while (to_us(at) / column_us_ >= static_cast<std::int64_t>(kMostColumns)) {
    for (std::size_t i = 0; i < columns_.size(); i += 2) {
      Column sum = columns_[i];
      if (i + 1 < columns_.size()) {
        sum.read += columns_[i + 1].read;
        sum.write += columns_[i + 1].write;
      }
      columns_[i / 2] = sum;
    }
    columns_.resize((columns_.size() + 1) / 2);
    column_us_ *= 2;
  }
  const auto index = static_cast<std::size_t>(to_us(at) / column_us_);
  if (index >= columns_.size()) columns_.resize(index + 1);
  return columns_[index];
}

void TapePlot::add_block(const Record& record) {
  const bool is_read = record.kind == RecordKind::read;
  Column& column = column_of(record.at);
  (is_read ? column.read : column.write) += record.data.size();
  bytes_.at(is_read ? 0 : 1) += record.data.size();
  if (record.piece_offset != 0) return;
  ++blocks_.at(is_read ? 0 : 1);
  if (!is_read) {
    exchanges_.on_write();
    asked_us_ = to_us(record.at);
    return;
  }
  if (!exchanges_.on_read()) return;
  const std::int64_t us = to_us(record.at) - asked_us_;
  latency_.add(us);
  const double bin = std::log10(static_cast<double>(std::max<std::int64_t>(us, 1))) * kBinsADecade;
  ++latencies_.at(std::min(static_cast<std::size_t>(bin), kBins - 1));
}

void TapePlot::add_event(const Record& record) {
  if (record.event == nullptr || std::holds_alternative<event::End>(*record.event)) return;
  const bool of_session = record.kind == RecordKind::open || record.kind == RecordKind::close;
  if (of_session) exchanges_.on_open_or_close();
  if (signs_.size() >= kMostEvents) {
    ++more_signs_;
    return;
  }
  Sign sign{.at = record.at, .from = record.at, .look = look_of(*record.event), .text = {}};
  sign.text = name_of(*record.event);
  if (const auto* const mark = std::get_if<event::Mark>(record.event)) sign.text = mark->text.for_line();
  if (const auto* const lost = std::get_if<event::DeviceLost>(record.event))
    sign.text += ": " + lost->why.for_line();
  if (const auto* const gap = std::get_if<event::Gap>(record.event)) {
    sign.from = gap->from.value_or(record.at);
    sign.look = "gap";
    sign.text = fmt::format("gap: {} bytes are missing, {}", gap->bytes, gap->why.for_line());
  }
  signs_.push_back(std::move(sign));
}

// What is drawn so far, and where a time is.
struct TapePlot::Picture {
  const TapePlot& plot;
  std::string out{};
  double range = std::max(1.0, static_cast<double>(plot.end_us_));

  [[nodiscard]] double x(double us) const { return kLeft + us / range * (kRight - kLeft); }
  template <class... Values>
  void put(fmt::format_string<Values...> form, Values&&... values) {
    fmt::format_to(std::back_inserter(out), form, std::forward<Values>(values)...);
    out += '\n';
  }
  void text(double at_x, double at_y, std::string_view look, std::string_view what) {
    put(R"(<text x="{:.1f}" y="{:.1f}" class="{}">{}</text>)", at_x, at_y, look, xml_text(what, false));
  }
  void line(double x1, double y1, double x2, double y2, std::string_view look) {
    put(R"(<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}" class="{}"/>)", x1, y1, x2, y2, look);
  }
  void head(std::string_view name, const std::vector<std::string>& notes);
  void time_axis(double y);
  void traffic();
  void signs();
  void rates();
  void rate_line(const std::vector<double>& rates, double most, std::string_view look);
  void latencies();
};

void TapePlot::Picture::head(std::string_view name, const std::vector<std::string>& notes) {
  put(R"(<svg xmlns="http://www.w3.org/2000/svg" width="{0}" height="{1}" viewBox="0 0 {0} {1}" role="img" aria-label="{2}">)",
      kWidth, kHeight, xml_text("traffic of the tape " + std::string(name), false));
  put("<style>{}</style>", kStyle);
  put(R"(<rect width="100%" height="100%" class="paper"/>)");
  text(kLeft, 30, "title", name);
  text(kLeft, 52, "faint",
       fmt::format("{} in all; from the device {} in {}, from the driver {} in {}; {}",
                   time_text(static_cast<double>(plot.end_us_)),
                   size_text(static_cast<double>(plot.bytes_[0])), counted(plot.blocks_[0], "block"),
                   size_text(static_cast<double>(plot.bytes_[1])), counted(plot.blocks_[1], "block"),
                   counted(plot.exchanges_.count(), "exchange")));
  double y = 68;
  for (const std::string& note : notes) {
    put(R"(<text x="{}" y="{}" class="bad">{}</text>)", kLeft, y, xml_text(note, false));
    y += 15;
  }
}

void TapePlot::Picture::time_axis(double y) {
  line(kLeft, y, kRight, y, "axis");
  const double step = step_of(range);
  for (double us = 0; us <= range * 1.0001; us += step) {
    line(x(us), y, x(us), y + 5, "axis");
    text(x(us), y + 18, "middle faint", tick_text(us, step));
  }
  text(kRight, y + 32, "end faint", "seconds since the driver's open");
}

// A bar a pixel column, as high as the logarithm of its bytes: single bytes are seen beside blocks.
void TapePlot::Picture::traffic() {
  const auto pixels = static_cast<std::size_t>(kRight - kLeft);
  std::vector<Column> sums(pixels + 1);
  for (std::size_t i = 0; i < plot.columns_.size(); ++i) {
    const double us = static_cast<double>(i) * static_cast<double>(plot.column_us_);
    Column& sum = sums.at(std::min(static_cast<std::size_t>(x(us) - kLeft), pixels));
    sum.read += plot.columns_[i].read;
    sum.write += plot.columns_[i].write;
  }
  std::uint64_t most = 1;
  for (const Column& sum : sums) most = std::max({most, sum.read, sum.write});
  const auto height = [&](std::uint64_t bytes) {
    return std::log2(1 + static_cast<double>(bytes)) / std::log2(1 + static_cast<double>(most)) * kHalf;
  };
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const double at = kLeft + static_cast<double>(i);
    if (const double up = height(sums[i].read); up > 0)
      put(R"(<rect x="{:.0f}" y="{:.1f}" width="1.2" height="{:.1f}" class="read"/>)", at, kAxis - up, up);
    if (const double down = height(sums[i].write); down > 0)
      put(R"(<rect x="{:.0f}" y="{:.1f}" width="1.2" height="{:.1f}" class="write"/>)", at, kAxis, down);
  }
  text(kLeft - 8, kAxis - kHalf / 2, "end read", "device");
  text(kLeft - 8, kAxis + kHalf / 2, "end write", "driver");
  text(kLeft - 8, kAxis - kHalf + 4, "end faint", size_text(static_cast<double>(most)));
  line(kLeft, kAxis, kRight, kAxis, "axis");
}

void TapePlot::Picture::signs() {
  const double top = kAxis - kHalf;
  const double bottom = kAxis + kHalf;
  for (const Sign& sign : plot.signs_) {
    const double at = x(static_cast<double>(to_us(sign.at)));
    const std::string title = fmt::format(
        "<title>{} s: {}</title>", static_cast<double>(to_us(sign.at)) / 1e6, xml_text(sign.text, false));
    if (sign.look == "gap") {
      const double from = x(static_cast<double>(to_us(sign.from)));
      put(R"(<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" class="gap">{}</rect>)", from, top,
          std::max(2.0, at - from), bottom - top, title);
      continue;
    }
    const bool is_small = sign.look == "other";
    put(R"(<line x1="{0:.1f}" y1="{1:.1f}" x2="{0:.1f}" y2="{2:.1f}" class="{3}">{4}</line>)", at,
        is_small ? bottom : top, bottom + 8, sign.look, title);
    if (sign.look == "mark") text(at + 3, top + 10, "faint", sign.text.substr(0, 40));
  }
  if (plot.more_signs_ > 0)
    text(kRight, top - 4, "end faint", fmt::format("{} further events are not drawn", plot.more_signs_));
}

void TapePlot::Picture::rate_line(const std::vector<double>& rates, double most, std::string_view look) {
  std::string points;
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(rates.size());
    fmt::format_to(std::back_inserter(points), "{:.1f},{:.1f} ", kLeft + share * (kRight - kLeft),
                   kRateBottom - rates[i] / most * (kRateBottom - kRateTop));
  }
  put(R"(<polyline points="{}" class="{}"/>)", points, look);
}

// Bytes a second, over a hundredth of the tape each.
void TapePlot::Picture::rates() {
  constexpr std::size_t kParts = 100;
  std::vector<double> read(kParts);
  std::vector<double> write(kParts);
  const double part_s = range / kParts / 1e6;
  for (std::size_t i = 0; i < plot.columns_.size(); ++i) {
    const double us = static_cast<double>(i) * static_cast<double>(plot.column_us_);
    const std::size_t part = std::min(static_cast<std::size_t>(us / range * kParts), kParts - 1);
    read[part] += static_cast<double>(plot.columns_[i].read) / part_s;
    write[part] += static_cast<double>(plot.columns_[i].write) / part_s;
  }
  const double most = std::max({1.0, *std::ranges::max_element(read), *std::ranges::max_element(write)});
  text(kLeft, kRateTop - 10, "head", "Bytes a second");
  text(kLeft - 8, kRateTop + 4, "end faint", size_text(most) + "/s");
  rate_line(read, most, "read-line");
  rate_line(write, most, "write-line");
  time_axis(kRateBottom);
}

void TapePlot::Picture::latencies() {
  text(kLeft, kLatencyTop - 32, "head", "From a request to its answer");
  if (plot.latency_.count() == 0) {
    text(kLeft, kLatencyTop, "faint", "no request of this tape is answered");
    return;
  }
  std::size_t first = 0;
  std::size_t last = kBins - 1;
  while (first + kBinsADecade < kBins && plot.latencies_.at(first) == 0) ++first;
  while (last > first && plot.latencies_.at(last) == 0) --last;
  first -= first % kBinsADecade;
  last = std::min(kBins, (last / kBinsADecade + 1) * kBinsADecade);
  const double wide = (kRight - kLeft) / static_cast<double>(last - first);
  const auto most = static_cast<double>(*std::ranges::max_element(plot.latencies_));
  const auto at = [&](double us) {
    return kLeft + (std::log10(std::max(us, 1.0)) * kBinsADecade - static_cast<double>(first)) * wide;
  };
  for (std::size_t bin = first; bin < last; ++bin) {
    const auto count = static_cast<double>(plot.latencies_.at(bin));
    if (count == 0) continue;
    const double high = std::max(1.0, count / most * (kLatencyBottom - kLatencyTop));
    put(R"(<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" class="read"><title>{}</title></rect>)",
        kLeft + static_cast<double>(bin - first) * wide + 1, kLatencyBottom - high, std::max(1.0, wide - 2),
        high, counted(plot.latencies_.at(bin), "answer"));
  }
  text(kLeft - 8, kLatencyTop + 4, "end faint", fmt::format("{}", most));
  line(kLeft, kLatencyBottom, kRight, kLatencyBottom, "axis");
  for (std::size_t bin = first; bin <= last; bin += kBinsADecade) {
    const double us = std::pow(10.0, static_cast<double>(bin) / kBinsADecade);
    text(at(us), kLatencyBottom + 18, "middle faint", time_text(us));
  }
  for (const auto& [share, name] : {std::pair{0.5, "median"}, std::pair{0.99, "p99"}}) {
    const auto us = static_cast<double>(plot.latency_.at(share));
    // One above the other, and above the bars.
    const double y = kLatencyTop - (share > 0.9 ? 18 : 5);
    line(at(us), y - 8, at(us), kLatencyBottom, "median");
    text(at(us) + 3, y, "", fmt::format("{} {}", name, time_text(us)));
  }
}

std::string TapePlot::svg(std::string_view name, const std::vector<std::string>& notes) const {
  Picture picture{*this};
  picture.head(name, notes);
  picture.traffic();
  picture.signs();
  picture.rates();
  picture.latencies();
  picture.out += "</svg>\n";
  return picture.out;
}

}  // namespace porttape
