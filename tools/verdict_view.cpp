#include "tools/verdict_view.hpp"

#include <fmt/format.h>
#include <fmt/ostream.h>

#include "libport/base/error.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/report_file.hpp"

namespace porttape {
namespace {

// Where a test could not begin since a report would have gone into its tape, it still must not.
Result<void> write_apart(const TestVerdict& verdict, const std::string& path, const std::string& text) {
  if (const Result<TapePaths> tape = find_tape(verdict.report.tape)) {
    if (Result<void> apart = check_report_apart(path, *tape); !apart) return apart;
  }
  return write_report(path, text, "report", verdict.kept);
}

// Writes both, whatever comes of the first. The first error. Where a test could not begin since both would
// have gone to one place, the report alone goes there.
Result<void> write_files(const TestVerdict& verdict, const ReportFiles& files) {
  const Result<void> apart = check_reports_apart(files.report, files.junit);
  Result<void> written;
  if (!files.report.empty()) written = write_apart(verdict, files.report, verdict.json());
  if (files.junit.empty() || !apart) return written;
  const TestCase test = verdict.as_case(verdict.report.tape, "porttape");
  const Result<void> junit =
      write_apart(verdict, files.junit, to_junit(files.verb, {&test, 1}, verdict.seconds));
  return written ? junit : written;
}

// A user's interrupt stays the outcome.
void fail(TestVerdict& verdict, const Error& trouble) {
  RunReport& report = verdict.report;
  if (verdict.error) {
    verdict.error->message += "; " + trouble.message;
  } else if (const int status = verdict.exit_status(); status <= exit_status::kDevice) {
    report.process_exit = worse_exit_status(status, exit_status_of(trouble.code));
    report.outcome = "failed: " + trouble.message +
                     (report.outcome.empty() ? std::string() : "; otherwise " + report.outcome);
  }
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

Result<int> end_test(TestVerdict verdict, const VerdictView& view, const ReportFiles& files,
                     std::ostream& out, std::ostream& err) {
  verdict.report.process_exit = verdict.exit_status();
  if (const Result<void> written = write_files(verdict, files); !written) {
    const Error& trouble = written.error();
    if (!verdict.error) fmt::print(err, "{}: {}\n", files.verb, printable_lines(trouble.message));
    fail(verdict, trouble);
    (void)write_files(verdict, files);  // what is there is not to say that all was well
  }
  tell(verdict, view, out);
  if (const int status = output_status(out, verdict.exit_status()); status != verdict.exit_status()) {
    verdict.report.process_exit = status;
    (void)write_files(verdict, files);
  }
  if (verdict.error) return *verdict.error;
  return verdict.exit_status();
}

}  // namespace porttape
