#include "tools/verdict_view.hpp"

#include "libport/tape/tape_name.hpp"
#include "libport/taped/report_file.hpp"

namespace porttape {
namespace {

// Where a test could not begin since a report would have gone into its tape, it still must not.
Result<void> write_apart(const TestVerdict& verdict, const std::string& path, const std::string& text) {
  if (const Result<TapePaths> tape = find_tape(verdict.report.tape)) {
    if (Result<void> apart = check_report_apart(path, *tape); !apart) return apart;
  }
  return write_report(path, text);
}

}  // namespace

std::vector<OptionSpec> view_options() { return {format_option(), color_option()}; }

Result<VerdictView> take_view(std::map<std::string, std::string>& values) {
  VerdictView view;
  if (const auto color = values.extract("color")) {
    const Result<ColorChoice> choice = read_color(color.mapped());
    if (!choice) return choice.error();
    view.color = *choice;
  }
  if (const auto format = values.extract("format")) {
    const Result<TestFormat> choice = read_format(format.mapped());
    if (!choice) return choice.error();
    view.format = *choice;
  }
  return view;
}

void tell(const TestVerdict& verdict, const VerdictView& view, std::ostream& out) {
  switch (view.format) {
    case TestFormat::text:
      if (!verdict.error) out << to_text(verdict.report, wants_color(out, view.color));
      break;
    case TestFormat::json:
      out << verdict.json();
      break;
    case TestFormat::tap:
      out << tap_head(1) << tap_of(verdict.as_case(verdict.report.tape, ""), 1);
  }
  out << std::flush;
}

Result<void> write_reports(const TestVerdict& verdict, std::string_view verb, const std::string& report,
                           const std::string& junit) {
  if (!report.empty()) {
    if (Result<void> written = write_apart(verdict, report, verdict.json()); !written) return written;
  }
  if (junit.empty()) return {};
  const TestCase test = verdict.as_case(verdict.report.tape, "porttape");
  return write_apart(verdict, junit, to_junit(verb, {&test, 1}, verdict.seconds));
}

}  // namespace porttape
