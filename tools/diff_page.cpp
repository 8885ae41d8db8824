// The page of `porttape diff --html`.

#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/base/xml_text.hpp"
#include "tools/diff_printer.hpp"

namespace porttape {
namespace {

constexpr std::size_t kPageColumns = 96;

constexpr std::string_view kPageHead = R"(<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
)";

constexpr std::string_view kPageStyle = R"(<style>
:root { color-scheme: light dark; --ground: #fff; --ink: #1f2328; --quiet: #59636e; --line: #d1d9e0;
  --less: #a40e26; --less-ground: #ffebe9; --more: #116329; --more-ground: #dafbe1; --time: #7d4e00;
  --mark: #ffd33d; --mark-ink: #1f2328 }
@media (prefers-color-scheme: dark) { :root { --ground: #0d1117; --ink: #f0f6fc; --quiet: #9198a1;
  --line: #3d444d; --less: #ff9492; --less-ground: #2d1316; --more: #4ae168; --more-ground: #0f2417;
  --time: #f0b72f; --mark: #f0b72f; --mark-ink: #0d1117 } }
body { margin: 2rem auto; max-width: 75rem; padding: 0 1rem; background: var(--ground); color: var(--ink);
  font: 1rem/1.5 system-ui, sans-serif }
h1 { font-size: 1.4rem } h2 { font-size: 1.1rem; margin-top: 2rem }
table { border-collapse: collapse } td, th { text-align: left; padding: .2rem 1.5rem .2rem 0 }
ol { list-style: none; padding: 0 }
li { border-top: 1px solid var(--line); padding: .6rem 0 }
.kind { display: inline-block; min-width: 5.5rem; font-weight: 600; color: var(--time) }
.added .kind { color: var(--more) } .missing .kind { color: var(--less) }
.bytes { margin: .3rem 0 0; overflow-x: auto; font: .875rem/1.5 ui-monospace, monospace }
.bytes div { white-space: pre; padding: 0 .5rem; min-width: max-content }
.one { color: var(--less); background: var(--less-ground) }
.other { color: var(--more); background: var(--more-ground) }
mark { background: var(--mark); color: var(--mark-ink) }
.quiet { color: var(--quiet) }
</style>
)";

std::string html_text(std::string_view text) { return xml_text(text, false); }

// The bytes in one form, those that differ marked.
std::string marked(const DifferenceLine& line, std::string (*form)(ByteView)) {
  std::string out;
  for (std::size_t i = 0; i < line.bytes.size();) {
    const auto differs = [&](std::size_t at) { return !line.differs.empty() && line.differs[at]; };
    std::size_t end = i + 1;
    while (end < line.bytes.size() && differs(end) == differs(i)) ++end;
    const std::string text = html_text(form(line.bytes.subspan(i, end - i)));
    out += differs(i) ? "<mark>" + text + "</mark>" : text;
    i = end;
  }
  return out + (line.cut ? "..." : "");
}

std::string line_html(const DifferenceLine& line) {
  const std::string_view side = line.of_other ? "other" : "one";
  const char sign = line.of_other ? '+' : '-';
  if (line.what == 'e') return fmt::format("<div class=\"{}\">{} {}</div>", side, sign, html_text(line.text));
  return fmt::format("<div class=\"{}\">{} {} {:>6}  {}  {}</div>", side, sign, line.what, line.offset,
                     marked(line, to_printable), marked(line, to_hex));
}

std::string tape_row(std::string_view sign, const std::string& name, const ComparedTape& tape) {
  return fmt::format("<tr><th scope=\"row\">{} {}</th><td>{}</td><td>{}</td></tr>\n", sign, html_text(name),
                     tape.exchanges, tape.events);
}

}  // namespace

Result<void> HtmlDiffPrinter::begin(const DiffTitle& title, const TapeDiff& diff) {
  const std::string names = html_text(title.one) + " and " + html_text(title.other);
  std::string page(kPageHead);
  page += "<title>porttape diff: " + names + "</title>\n";
  page += kPageStyle;
  page += "</head>\n<body>\n<main>\n<h1>" + names + "</h1>\n";
  page += diff.equal() ? "<p><strong>The tapes are the same.</strong></p>\n"
                       : "<p><strong>Different</strong>: " + counts_text(diff) + "</p>\n";
  page +=
      "<table>\n<tr><th scope=\"col\">tape</th><th scope=\"col\">exchanges</th>"
      "<th scope=\"col\">events</th></tr>\n";
  page += tape_row("-", title.one, diff.one) + tape_row("+", title.other, diff.other) + "</table>\n";
  page += "<p class=\"quiet\">" + agreement_text(diff, title.margin) + ".</p>\n";
  return file_.add(page);
}

Result<void> HtmlDiffPrinter::difference(const ShownDifference& difference) {
  const std::string_view kind = to_string(difference.what.kind);
  std::string item = listing_ ? "" : "<h2>Differences</h2>\n<ol>\n";
  listing_ = true;
  item += fmt::format("<li class=\"{}\"><span class=\"kind\">{}</span> {}", kind, kind,
                      html_text(headline_of(difference)));
  const std::vector<DifferenceLine> lines = lines_of(difference, kPageColumns);
  if (!lines.empty()) item += "\n<div class=\"bytes\" tabindex=\"0\" role=\"group\" aria-label=\"bytes\">";
  for (const DifferenceLine& line : lines) item += line_html(line);
  if (!lines.empty()) item += "</div>";
  return file_.add(item + "</li>\n");
}

Result<void> HtmlDiffPrinter::end(std::uint64_t more) {
  std::string page = listing_ ? "</ol>\n" : "";
  if (more > 0) page += fmt::format("<p>... and {} more; --all shows them</p>\n", more);
  return file_.add(page + "</main>\n</body>\n</html>\n");
}

}  // namespace porttape
