#pragma once

#include <asm/termbits.h>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <sys/ioctl.h>

#include "libport/line/line_settings.hpp"

// What the requests TCSETS… of a program carry. Not to be included with <termios.h>.
namespace porttape {

// How a request carries the settings.
struct SettingsForm {
  std::size_t size = 0;
  std::size_t flags_at = 0;
  std::size_t flags_size = 0;
};

inline SettingsForm form_of(std::uint32_t request) {
  switch (request) {
    case TCGETS2:
    case TCSETS2:
    case TCSETSW2:
    case TCSETSF2:
      return {sizeof(termios2), offsetof(termios2, c_cflag), sizeof(tcflag_t)};
    case TCGETA:
    case TCSETA:
    case TCSETAW:
    case TCSETAF:
      return {sizeof(termio), offsetof(termio, c_cflag), sizeof(unsigned short)};
    default:
      return {sizeof(termios), offsetof(termios, c_cflag), sizeof(tcflag_t)};
  }
}

inline tcflag_t flags_in(const SettingsForm& form, const std::byte* settings) {
  tcflag_t flags = 0;  // a termio has its low half; of what is hidden that lacks CMSPAR alone
  std::memcpy(&flags, settings + form.flags_at, form.flags_size);
  return flags;
}

inline bool flushes_input(std::uint32_t request) {
  return request == TCSETSF || request == TCSETSF2 || request == TCSETAF;
}

// The same settings without waiting for what was written, nor a flush.
inline std::uint32_t made_at_once(std::uint32_t request) {
  switch (request) {
    case TCSETSW:
    case TCSETSF:
      return TCSETS;
    case TCSETSW2:
    case TCSETSF2:
      return TCSETS2;
    case TCSETAW:
    case TCSETAF:
      return TCSETA;
    default:
      return request;
  }
}

inline unsigned data_bits_of(tcflag_t flags) {
  switch (flags & CSIZE) {
    case CS5:
      return 5;
    case CS6:
      return 6;
    case CS7:
      return 7;
    default:
      return 8;
  }
}

inline Parity parity_of(tcflag_t flags) {
  if ((flags & PARENB) == 0) return Parity::none;
  const bool odd = (flags & PARODD) != 0;
  if ((flags & CMSPAR) != 0) return odd ? Parity::mark : Parity::space;
  return odd ? Parity::odd : Parity::even;
}

}  // namespace porttape
