#include "libport/tty/pty_settings.hpp"

namespace porttape {

Result<void> PtySettings::show(const LineSettings& settings) {
  if (Result<void> shown = show_settings(master_, settings); !shown) return shown;
  take_as_known();
  return {};
}

void PtySettings::take_as_known() {
  (void)look(false);
  sets_clocal_ = false;
}

void PtySettings::assume(const std::optional<LineSettings>& settings) {
  if (!settings) return take_as_known();
  sets_clocal_ = false;
  known_ = SeenSettings::of(*settings);
  known_.data_bits.reset();
  known_.parity.reset();
}

std::optional<SeenSettings> PtySettings::look(bool moved_on) {
  const Result<ShownSettings> shown = shown_settings(master_);
  if (!shown) return std::nullopt;
  keep_changeable(*shown, moved_on);
  if (shown->settings == known_) return std::nullopt;
  known_ = shown->settings;
  return known_;
}

void PtySettings::keep_changeable(const ShownSettings& shown, bool moved_on) {
  sets_clocal_ = sets_clocal_ || shown.clocal;
  const bool clocal_stands = shown.clocal && (clocal_set_ || moved_on);
  const bool ignbrk_stands = shown.ignbrk_cleared && ignbrk_cleared_ && !sets_clocal_;
  clocal_set_ = shown.clocal && !clocal_stands;
  ignbrk_cleared_ = shown.ignbrk_cleared && !ignbrk_stands;
  if (clocal_stands) clear_clocal(master_);
  if (ignbrk_stands) set_ignbrk(master_);
}

}  // namespace porttape
