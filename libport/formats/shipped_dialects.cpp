#include "libport/formats/shipped_dialects.hpp"

#include <array>

namespace porttape {
namespace {

// bellows, zigpy and other programs that log bytes by Python's %s or %r of bytes, or their hex().
constexpr std::string_view kPythonHex = R"toml(
name = "python-hex"
what = "hex dumps of Python's logging: bellows, zigpy"
write = ["Sending", "Sending data", "Sent", "Send", "TX", "Tx", "tx", "Write", "Writing", "write", "Wrote"]
read = ["Data frame", "Received", "Received data", "Recv", "RX", "Rx", "rx", "Read", "read"]
[[line]]
pattern = '''^(?:.*?TIME )?.*?\b(?P<direction>Sending data|Received data|Sending|Sent|Send|Data frame|Received|Recv|TX|Tx|tx|RX|Rx|rx|Write|Writing|write|Wrote|Read|read):? +(?P<bytes>(?:(?:0x)?[0-9a-fA-F]{2}[ :,]?)+)(?: *\(\d+ bytes\))?$'''
[[line]]
pattern = '''^(?:.*?TIME )?.*?\b(?P<direction>Sending data|Received data|Sending|Sent|Send|Data frame|Received|Recv|TX|Tx|tx|RX|Rx|rx|Write|Writing|write|Wrote|Read|read):? +b?'(?P<bytes>(?:(?:0x)?[0-9a-fA-F]{2}[ :,]?)+)'(?: *\(\d+ bytes\))?$'''
[[line]]
pattern = '''^(?:.*?TIME )?.*?\b(?P<direction>Sending data|Received data|Sending|Sent|Send|Data frame|Received|Recv|TX|Tx|tx|RX|Rx|rx|Write|Writing|write|Wrote|Read|read):? +b?"(?P<bytes>(?:(?:0x)?[0-9a-fA-F]{2}[ :,]?)+)"(?: *\(\d+ bytes\))?$'''
[[line]]
pattern = '''^(?:.*?TIME )?.*?\b(?P<direction>Sending data|Received data|Sending|Sent|Send|Data frame|Received|Recv|TX|Tx|tx|RX|Rx|rx|Write|Writing|write|Wrote|Read|read):? +b"(?P<bytes>.*)"$'''
bytes = "escaped"
[[line]]
pattern = '''^(?:.*?TIME )?.*?\b(?P<direction>Sending data|Received data|Sending|Sent|Send|Data frame|Received|Recv|TX|Tx|tx|RX|Rx|rx|Write|Writing|write|Wrote|Read|read):? +b'(?P<bytes>.*)'$'''
bytes = "escaped"
)toml";

constexpr std::string_view kZwaveJs = R"toml(
name = "zwave-js"
what = "the SERIAL lines of zwave-js"
write = ["»"]
read = ["«"]
[[line]]
pattern = '^(?:.*?TIME )?SERIAL +(?P<direction>»|«) +(?:\[\w+\] +\()?0x(?P<bytes>(?:[0-9a-fA-F]{2})+)'
)toml";

constexpr std::string_view kOctoprint = R"toml(
name = "octoprint"
what = "Send: and Recv: of OctoPrint, SENT: and RECV: of printcore"
write = ["Send", "SENT", ">>>"]
read = ["Recv", "RECV", "<<<"]
guess = ["lines end with \\n"]
skip = ['(?:Changing monitoring state|Connecting to|Connected to|Send: \[)']
[[line]]
pattern = '^(?:.*?TIME)?(?:.*? - | ?\| ?| +)?(?P<direction>Send|Recv|SENT|RECV|>>>|<<<):? (?P<bytes>.*)$'
bytes = "text"
end = "\n"
)toml";

constexpr std::string_view kMinicom = R"toml(
name = "minicom"
what = "a capture of minicom with its timestamps"
guess = ["all bytes are the device's", "lines end with \\r\\n"]
detect = false
[[line]]
pattern = '^\[?TIME\]? (?P<bytes>.*)$'
bytes = "text"
direction = "r"
end = "\r\n"
[[line]]
pattern = '^(?P<bytes>.*)$'
bytes = "text"
direction = "r"
end = "\r\n"
)toml";

constexpr std::string_view kPicocom = R"toml(
name = "picocom"
what = "a log of picocom, [0d] for what cannot be shown (--imap …hex)"
guess = ["all bytes are the device's", "lines end with \\n"]
detect = false
[[line]]
pattern = '^(?P<bytes>.*)$'
bytes = "bracketed"
direction = "r"
end = "\n"
)toml";

constexpr std::string_view kInterceptty = R"toml(
name = "interceptty"
what = "interceptty: a byte a line, < what the program wrote"
write = ["<"]
read = [">"]
guess = ["< is what the program wrote (--swap: what it read)"]
[[line]]
pattern = '^(?:TIME )?(?P<direction>[<>])\s+0x(?P<bytes>[0-9a-fA-F]{2})\b'
row = 1
)toml";

constexpr std::string_view kSer2net = R"toml(
name = "ser2net"
what = "a trace of ser2net with trace-…-hexdump"
write = ["tcp"]
read = ["term"]
skip = ['(?:OPEN|CLOSE) [^|]*$']
[[line]]
pattern = '^(?:TIME )?(?P<direction>tcp|term) +(?P<bytes>(?:[0-9a-f]{2} ){1,8}) *\|'
row = 8
)toml";

constexpr std::array<std::string_view, 7> kShipped{kPythonHex, kZwaveJs,     kOctoprint, kMinicom,
                                                   kPicocom,   kInterceptty, kSer2net};

}  // namespace

std::string_view shipped_dialect(ShippedDialect which) {
  return kShipped.at(static_cast<std::size_t>(which));
}

}  // namespace porttape
