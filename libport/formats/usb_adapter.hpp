#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "libport/formats/import_tape.hpp"
#include "libport/formats/usb_urb.hpp"

namespace porttape {

enum class UsbAdapterKind : std::uint8_t { cdc_acm, ftdi, cp210x, pl2303 };

std::string_view name_of(UsbAdapterKind kind);
std::optional<UsbAdapterKind> usb_adapter_named(std::string_view name);
// By the vendor of the device; nothing: none of these.
std::optional<UsbAdapterKind> usb_adapter_of(std::uint16_t vendor);
// By a request that a driver makes of such a device alone.
std::optional<UsbAdapterKind> usb_adapter_of(const UsbUrb::Setup& setup);

// What a driver does with its serial adapter, as a tape: bulk transfers are bytes, control requests settings,
// signals, breaks and flushes.
class UsbAdapter {
 public:
  UsbAdapter(ImportTape& to, UsbAdapterKind kind) : to_(to), kind_(kind) {}

  // FTDI: bytes of a packet, of which the first two are its status; versions of the chip; which port it is.
  void packet_size(std::size_t bytes) { packet_size_ = bytes; }
  void version(std::uint16_t bcd_device) { version_ = bcd_device; }
  void port(unsigned number) { port_ = number; }

  // `setup`: the request that a done control transfer was submitted with.
  Result<void> take(TapeTime at, const UsbUrb& urb, const std::optional<UsbUrb::Setup>& setup);
  // Whether it says anything that stands on a tape: time begins with the first that does.
  [[nodiscard]] bool tells(const UsbUrb& urb, const std::optional<UsbUrb::Setup>& setup) const;
  // A break that was asked for by its length ends.
  Result<void> until(TapeTime at);

 private:
  Result<void> bulk(const UsbUrb& urb);
  Result<void> ftdi_packets(ByteView data);
  Result<void> cdc_request(const UsbUrb::Setup& setup, ByteView data);
  Result<void> ftdi_request(const UsbUrb::Setup& setup);
  Result<void> cp210x_request(const UsbUrb::Setup& setup, ByteView data);
  Result<void> notification(ByteView data);
  [[nodiscard]] unsigned ftdi_baud(const UsbUrb::Setup& setup) const;

  Result<void> settings(const SeenSettings& line);
  // Of the driver's lines; each is told when it changes.
  Result<void> outputs(std::optional<bool> dtr, std::optional<bool> rts);
  // The same of the device's, whose first state is told whole.
  struct Inputs {
    bool cts = false, dsr = false, cd = false, ri = false;
    friend bool operator==(const Inputs&, const Inputs&) = default;
  };
  Result<void> inputs(const Inputs& now, bool has_cts);
  Result<void> signal(Side by, LineSignal::Name name, bool on);
  Result<void> line_break(Side by, bool on);
  Result<void> flush(bool in, bool out);

  ImportTape& to_;
  UsbAdapterKind kind_;
  std::size_t packet_size_ = 64;
  std::uint16_t version_ = 0;
  unsigned port_ = 1;
  TapeTime at_{};
  SeenSettings line_;
  bool open_ = true;
  bool dtr_ = true;
  bool rts_ = true;
  std::optional<Inputs> inputs_;
  bool broken_ = false;
  bool device_broken_ = false;
  std::optional<TapeTime> break_ends_;
};

}  // namespace porttape
