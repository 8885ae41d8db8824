#include "tools/view_page.hpp"

#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/formats/base64.hpp"

namespace porttape {
namespace {

constexpr std::string_view kDataPlace = "<!-- data -->\n";

// As a Content-Security-Policy names what it lets run.
std::string source_hash(std::string_view hex) {
  return "'sha256-" + to_base64(bytes_of_hex(hex).value_or(Bytes{})) + "'";
}

std::string filled(std::string_view text) {
  std::string out(text);
  const auto fill = [&out](std::string_view place, std::string_view with) {
    if (const std::size_t at = out.find(place); at != std::string::npos) out.replace(at, place.size(), with);
  };
  fill("{{style-hash}}", source_hash(kViewStyleHash));
  fill("{{script-hash}}", source_hash(kViewScriptHash));
  fill("{{style}}", kViewStyle);
  fill("{{script}}", kViewScript);
  return out;
}

}  // namespace

std::string view_page_head() { return filled(kViewHtml.substr(0, kViewHtml.find(kDataPlace))); }

std::string view_page_tail() {
  const std::size_t at = kViewHtml.find(kDataPlace);
  return filled(kViewHtml.substr(at + kDataPlace.size()));
}

}  // namespace porttape
