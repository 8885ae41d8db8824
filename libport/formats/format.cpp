#include "libport/formats/format.hpp"

#include <algorithm>
#include <array>

#include "libport/formats/csv_format.hpp"
#include "libport/formats/dialect_format.hpp"
#include "libport/formats/gdb_format.hpp"
#include "libport/formats/gpsd_format.hpp"
#include "libport/formats/json_format.hpp"
#include "libport/formats/mcap_format.hpp"
#include "libport/formats/raw_format.hpp"
#include "libport/formats/reserial_format.hpp"
#include "libport/formats/rtac_format.hpp"
#include "libport/formats/saleae_format.hpp"
#include "libport/formats/socat_format.hpp"
#include "libport/formats/socat_raw_format.hpp"
#include "libport/formats/sr_format.hpp"
#include "libport/formats/strace_format.hpp"
#include "libport/formats/text_format.hpp"
#include "libport/formats/umockdev_format.hpp"
#include "libport/formats/usbmon_format.hpp"

namespace porttape {
namespace {

constexpr std::array kFormats{
    Format{"text", "editable text, exact both ways (FORMATS.md)", import_text, export_text, detect_text,
           "txt text"},
    Format{"json", "an object a line, as cat --json; exact both ways", import_json, export_json, detect_json,
           "json jsonl"},
    Format{"csv", "a table: seconds,kind,data; exact both ways", import_csv, export_csv, detect_csv, "csv"},
    Format{"strace", "strace -f -xx -ttt -T -s 65536; --device PATH", import_strace, nullptr, detect_strace,
           "strace"},
    Format{"raw", "the bytes alone; read: as the device's", import_raw, export_raw, nullptr, "raw bin"},
    Format{"socat-x", "what socat -x, -v or both tell; > is the driver", import_socat, nullptr, detect_socat,
           ""},
    Format{"socat-rR", "the files of socat -r IN -R FILE (--with FILE)", import_socat_raw, nullptr, nullptr,
           ""},
    Format{"umockdev", "a script of umockdev, to its millisecond", import_umockdev, export_umockdev,
           detect_umockdev, "script"},
    Format{"gpsd", "a log for gpsd's tests: what a receiver said", import_gpsd, export_gpsd, detect_gpsd, ""},
    Format{"gdb", "gdb's remotelogfile", import_gdb, nullptr, detect_gdb, ""},
    Format{"dialect", "a text log, as a file tells it: --from FILE.toml", import_dialect, nullptr, nullptr,
           ""},
    shipped_format<"python-hex">("Python's logging of bytes: bellows, zigpy"),
    shipped_format<"zwave-js">("the SERIAL lines of zwave-js"),
    shipped_format<"octoprint">("Send: and Recv: of OctoPrint, printcore"),
    shipped_format<"minicom">("a capture of minicom with its timestamps"),
    shipped_format<"picocom">("a log of picocom with [0d]"),
    shipped_format<"interceptty">("a byte a line, < what the program wrote"),
    shipped_format<"ser2net">("a trace of ser2net with hexdump"),
    // Binary captures: BINARY.md.
    Format{"pcapng", "packets of RTAC serial, for Wireshark; exact both ways", import_rtac, export_pcapng,
           detect_pcapng, "pcapng"},
    Format{"rtac", "the same as pcap: bytes, times, lines and breaks", import_rtac, export_rtac, detect_rtac,
           "pcap"},
    Format{"sr", "sigrok's levels of rx and tx; --device rx=D0,tx=D1", import_sr, export_sr, detect_sr, "sr",
           export_sr_at},
    Format{"usbmon", "CDC-ACM, FTDI, CP210x, PL2303; --device BUS.ADDRESS", import_usbmon, nullptr,
           detect_usbmon, ""},
    Format{"mcap", "MCAP, exact both ways; --device rx=TOPIC,tx=TOPIC", import_mcap, export_mcap, detect_mcap,
           "mcap"},
    Format{"saleae", "Logic's tables; --device rx=NAME,tx=NAME", import_saleae, nullptr, detect_saleae, ""},
    Format{"pytest-reserial", "its JSON: bytes without times; --device TEST", import_reserial,
           export_reserial, detect_reserial, ""},
};

bool has_suffix(std::string_view suffixes, std::string_view suffix) {
  while (!suffixes.empty()) {
    const std::size_t space = suffixes.find(' ');
    if (suffixes.substr(0, space) == suffix) return true;
    if (space == std::string_view::npos) break;
    suffixes.remove_prefix(space + 1);
  }
  return false;
}

}  // namespace

std::span<const Format> formats() { return kFormats; }

const Format* find_format(std::string_view name) {
  const auto* const found = std::ranges::find(kFormats, name, &Format::name);
  return found == kFormats.end() ? nullptr : found;
}

const Format* detect_format(std::string_view head, std::string_view name) {
  const Format* best = nullptr;
  int surest = 0;
  for (const Format& format : kFormats) {
    const int sure = format.detect == nullptr ? 0 : format.detect(head);
    if (sure > surest) {
      surest = sure;
      best = &format;
    }
  }
  if (best != nullptr) return best;
  const std::size_t dot = name.rfind('.');
  if (dot == std::string_view::npos) return nullptr;
  for (const Format& format : kFormats) {
    if (has_suffix(format.suffixes, name.substr(dot + 1))) return &format;
  }
  return nullptr;
}

}  // namespace porttape
