#include <array>
#include <cctype>
#include <utility>

#include "libport/base/checksum.hpp"

namespace porttape {
namespace {

using Algorithm = ChecksumKind::Algorithm;

constexpr bool kReflected = true;
constexpr bool kPlain = false;

constexpr ChecksumKind crc(std::string_view name, unsigned width, std::uint32_t poly, std::uint32_t init,
                           bool reflected, std::uint32_t xor_out, std::uint32_t check) {
  return {name, Algorithm::crc, {width, poly, init, reflected, xor_out}, check};
}

constexpr ChecksumKind other(std::string_view name, Algorithm algorithm, unsigned width,
                             std::uint32_t check) {
  return {name, algorithm, {.width = width}, check};
}

// Names and parameters of https://reveng.sourceforge.io/crc-catalogue/, and what is no CRC behind them.
constexpr std::array kKinds = {
    crc("CRC-8/AUTOSAR", 8, 0x2f, 0xff, kPlain, 0xff, 0xdf),
    crc("CRC-8/BLUETOOTH", 8, 0xa7, 0x00, kReflected, 0x00, 0x26),
    crc("CRC-8/CDMA2000", 8, 0x9b, 0xff, kPlain, 0x00, 0xda),
    crc("CRC-8/DARC", 8, 0x39, 0x00, kReflected, 0x00, 0x15),
    crc("CRC-8/DVB-S2", 8, 0xd5, 0x00, kPlain, 0x00, 0xbc),
    crc("CRC-8/GSM-A", 8, 0x1d, 0x00, kPlain, 0x00, 0x37),
    crc("CRC-8/GSM-B", 8, 0x49, 0x00, kPlain, 0xff, 0x94),
    crc("CRC-8/HITAG", 8, 0x1d, 0xff, kPlain, 0x00, 0xb4),
    crc("CRC-8/I-432-1", 8, 0x07, 0x00, kPlain, 0x55, 0xa1),
    crc("CRC-8/I-CODE", 8, 0x1d, 0xfd, kPlain, 0x00, 0x7e),
    crc("CRC-8/LTE", 8, 0x9b, 0x00, kPlain, 0x00, 0xea),
    crc("CRC-8/MAXIM-DOW", 8, 0x31, 0x00, kReflected, 0x00, 0xa1),
    crc("CRC-8/MIFARE-MAD", 8, 0x1d, 0xc7, kPlain, 0x00, 0x99),
    crc("CRC-8/NRSC-5", 8, 0x31, 0xff, kPlain, 0x00, 0xf7),
    crc("CRC-8/OPENSAFETY", 8, 0x2f, 0x00, kPlain, 0x00, 0x3e),
    crc("CRC-8/ROHC", 8, 0x07, 0xff, kReflected, 0x00, 0xd0),
    crc("CRC-8/SAE-J1850", 8, 0x1d, 0xff, kPlain, 0xff, 0x4b),
    crc("CRC-8/SMBUS", 8, 0x07, 0x00, kPlain, 0x00, 0xf4),
    crc("CRC-8/TECH-3250", 8, 0x1d, 0xff, kReflected, 0x00, 0x97),
    crc("CRC-8/WCDMA", 8, 0x9b, 0x00, kReflected, 0x00, 0x25),
    crc("CRC-16/ARC", 16, 0x8005, 0x0000, kReflected, 0x0000, 0xbb3d),
    crc("CRC-16/CDMA2000", 16, 0xc867, 0xffff, kPlain, 0x0000, 0x4c06),
    crc("CRC-16/CMS", 16, 0x8005, 0xffff, kPlain, 0x0000, 0xaee7),
    crc("CRC-16/DDS-110", 16, 0x8005, 0x800d, kPlain, 0x0000, 0x9ecf),
    crc("CRC-16/DECT-R", 16, 0x0589, 0x0000, kPlain, 0x0001, 0x007e),
    crc("CRC-16/DECT-X", 16, 0x0589, 0x0000, kPlain, 0x0000, 0x007f),
    crc("CRC-16/DNP", 16, 0x3d65, 0x0000, kReflected, 0xffff, 0xea82),
    crc("CRC-16/EN-13757", 16, 0x3d65, 0x0000, kPlain, 0xffff, 0xc2b7),
    crc("CRC-16/GENIBUS", 16, 0x1021, 0xffff, kPlain, 0xffff, 0xd64e),
    crc("CRC-16/GSM", 16, 0x1021, 0x0000, kPlain, 0xffff, 0xce3c),
    crc("CRC-16/IBM-3740", 16, 0x1021, 0xffff, kPlain, 0x0000, 0x29b1),
    crc("CRC-16/IBM-SDLC", 16, 0x1021, 0xffff, kReflected, 0xffff, 0x906e),
    crc("CRC-16/ISO-IEC-14443-3-A", 16, 0x1021, 0xc6c6, kReflected, 0x0000, 0xbf05),
    crc("CRC-16/KERMIT", 16, 0x1021, 0x0000, kReflected, 0x0000, 0x2189),
    crc("CRC-16/LJ1200", 16, 0x6f63, 0x0000, kPlain, 0x0000, 0xbdf4),
    crc("CRC-16/M17", 16, 0x5935, 0xffff, kPlain, 0x0000, 0x772b),
    crc("CRC-16/MAXIM-DOW", 16, 0x8005, 0x0000, kReflected, 0xffff, 0x44c2),
    crc("CRC-16/MCRF4XX", 16, 0x1021, 0xffff, kReflected, 0x0000, 0x6f91),
    crc("CRC-16/MODBUS", 16, 0x8005, 0xffff, kReflected, 0x0000, 0x4b37),
    crc("CRC-16/NRSC-5", 16, 0x080b, 0xffff, kReflected, 0x0000, 0xa066),
    crc("CRC-16/OPENSAFETY-A", 16, 0x5935, 0x0000, kPlain, 0x0000, 0x5d38),
    crc("CRC-16/OPENSAFETY-B", 16, 0x755b, 0x0000, kPlain, 0x0000, 0x20fe),
    crc("CRC-16/PROFIBUS", 16, 0x1dcf, 0xffff, kPlain, 0xffff, 0xa819),
    crc("CRC-16/RIELLO", 16, 0x1021, 0xb2aa, kReflected, 0x0000, 0x63d0),
    crc("CRC-16/SPI-FUJITSU", 16, 0x1021, 0x1d0f, kPlain, 0x0000, 0xe5cc),
    crc("CRC-16/T10-DIF", 16, 0x8bb7, 0x0000, kPlain, 0x0000, 0xd0db),
    crc("CRC-16/TELEDISK", 16, 0xa097, 0x0000, kPlain, 0x0000, 0x0fb3),
    crc("CRC-16/TMS37157", 16, 0x1021, 0x89ec, kReflected, 0x0000, 0x26b1),
    crc("CRC-16/UMTS", 16, 0x8005, 0x0000, kPlain, 0x0000, 0xfee8),
    crc("CRC-16/USB", 16, 0x8005, 0xffff, kReflected, 0xffff, 0xb4c8),
    crc("CRC-16/XMODEM", 16, 0x1021, 0x0000, kPlain, 0x0000, 0x31c3),
    crc("CRC-24/BLE", 24, 0x00065b, 0x555555, kReflected, 0x000000, 0xc25a56),
    crc("CRC-24/FLEXRAY-A", 24, 0x5d6dcb, 0xfedcba, kPlain, 0x000000, 0x7979bd),
    crc("CRC-24/FLEXRAY-B", 24, 0x5d6dcb, 0xabcdef, kPlain, 0x000000, 0x1f23b8),
    crc("CRC-24/INTERLAKEN", 24, 0x328b63, 0xffffff, kPlain, 0xffffff, 0xb4f3e6),
    crc("CRC-24/LTE-A", 24, 0x864cfb, 0x000000, kPlain, 0x000000, 0xcde703),
    crc("CRC-24/LTE-B", 24, 0x800063, 0x000000, kPlain, 0x000000, 0x23ef52),
    crc("CRC-24/OPENPGP", 24, 0x864cfb, 0xb704ce, kPlain, 0x000000, 0x21cf02),
    crc("CRC-24/OS-9", 24, 0x800063, 0xffffff, kPlain, 0xffffff, 0x200fa5),
    crc("CRC-32/AIXM", 32, 0x814141ab, 0x00000000, kPlain, 0x00000000, 0x3010bf7f),
    crc("CRC-32/AUTOSAR", 32, 0xf4acfb13, 0xffffffff, kReflected, 0xffffffff, 0x1697d06a),
    crc("CRC-32/BASE91-D", 32, 0xa833982b, 0xffffffff, kReflected, 0xffffffff, 0x87315576),
    crc("CRC-32/BZIP2", 32, 0x04c11db7, 0xffffffff, kPlain, 0xffffffff, 0xfc891918),
    crc("CRC-32/CD-ROM-EDC", 32, 0x8001801b, 0x00000000, kReflected, 0x00000000, 0x6ec2edc4),
    crc("CRC-32/CKSUM", 32, 0x04c11db7, 0x00000000, kPlain, 0xffffffff, 0x765e7680),
    crc("CRC-32/ISCSI", 32, 0x1edc6f41, 0xffffffff, kReflected, 0xffffffff, 0xe3069283),
    crc("CRC-32/ISO-HDLC", 32, 0x04c11db7, 0xffffffff, kReflected, 0xffffffff, 0xcbf43926),
    crc("CRC-32/JAMCRC", 32, 0x04c11db7, 0xffffffff, kReflected, 0x00000000, 0x340bc6d9),
    crc("CRC-32/MEF", 32, 0x741b8cd7, 0xffffffff, kReflected, 0x00000000, 0xd2c22f51),
    crc("CRC-32/MPEG-2", 32, 0x04c11db7, 0xffffffff, kPlain, 0x00000000, 0x0376e6e7),
    crc("CRC-32/XFER", 32, 0x000000af, 0x00000000, kPlain, 0x00000000, 0xbd0be338),
    other("LRC", Algorithm::negative_sum, 8, 0x23),
    other("XOR", Algorithm::exclusive_or, 8, 0x31),
    other("SUM-8", Algorithm::sum, 8, 0xdd),
    other("SUM-16", Algorithm::sum, 16, 0x01dd),
    other("SUM-32", Algorithm::sum, 32, 0x000001dd),
    other("FLETCHER-16", Algorithm::fletcher, 16, 0x1ede),
    other("FLETCHER-32", Algorithm::fletcher, 32, 0xdf09d509),
    other("FLETCHER-UBX", Algorithm::fletcher_ubx, 16, 0xdd15),
    other("SCIP", Algorithm::scip, 8, 0x4d),
};

constexpr std::array<std::pair<std::string_view, std::string_view>, 22> kAliases = {{
    {"CRC-8", "CRC-8/SMBUS"},
    {"CRC-8/MAXIM", "CRC-8/MAXIM-DOW"},
    {"CRC-8/ITU", "CRC-8/I-432-1"},
    {"CRC-8/EBU", "CRC-8/TECH-3250"},
    {"CRC-16", "CRC-16/ARC"},
    {"CRC-16/IBM", "CRC-16/ARC"},
    {"CRC-16/CCITT-FALSE", "CRC-16/IBM-3740"},
    {"CRC-16/CCITT", "CRC-16/KERMIT"},
    {"CRC-16/AUG-CCITT", "CRC-16/SPI-FUJITSU"},
    {"CRC-16/X-25", "CRC-16/IBM-SDLC"},
    {"CRC-16/BUYPASS", "CRC-16/UMTS"},
    {"CRC-16/ZMODEM", "CRC-16/XMODEM"},
    {"MODBUS", "CRC-16/MODBUS"},
    {"X-25", "CRC-16/IBM-SDLC"},
    {"KERMIT", "CRC-16/KERMIT"},
    {"XMODEM", "CRC-16/XMODEM"},
    {"MAVLINK", "CRC-16/MCRF4XX"},
    {"CRC-24", "CRC-24/OPENPGP"},
    {"CRC-32", "CRC-32/ISO-HDLC"},
    {"CRC-32C", "CRC-32/ISCSI"},
    {"SUM", "SUM-8"},
    {"NMEA", "XOR"},
}};

bool same_word(std::string_view one, std::string_view other) {
  if (one.size() != other.size()) return false;
  for (std::size_t i = 0; i < one.size(); ++i) {
    if (std::toupper(static_cast<unsigned char>(one[i])) !=
        std::toupper(static_cast<unsigned char>(other[i])))
      return false;
  }
  return true;
}

}  // namespace

std::span<const ChecksumKind> checksum_kinds() { return kKinds; }

const ChecksumKind* find_checksum(std::string_view name) {
  for (const auto& [alias, meant] : kAliases) {
    if (same_word(alias, name)) name = meant;
  }
  for (const ChecksumKind& kind : kKinds) {
    if (same_word(kind.name, name)) return &kind;
  }
  return nullptr;
}

}  // namespace porttape
