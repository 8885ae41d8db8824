#include <string>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"
#include "tests/formats/usb_capture.hpp"

namespace porttape {
namespace {

using namespace std::string_literals;
using test::CaptureBytes;
using test::imported;
using test::lines_of;
using test::UsbCapture;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::uint64_t kStart = 1'700'000'000'000'000;

class UsbmonFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> read(const std::string& text, const std::string& device = "") {
    ImportOptions options;
    if (!device.empty()) options.device = device;
    EXPECT_EQ(detect_format(text, ""), find_format("usbmon"));
    return imported(dir, "t" + std::to_string(++made_), "usbmon", text, options);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

std::string modem(int us, const char* line, const char* state, const char* by) {
  return R"({"t_us":)" + std::to_string(us) + R"(,"event":"modem","line":")" + line + R"(","state":")" +
         state + R"(","by":")" + by + "\"}";
}

class UsbHeads : public UsbmonFormatTest, public testing::WithParamInterface<std::tuple<Endian, bool>> {};

TEST_P(UsbHeads, CdcAcm) {
  const auto [endian, long_head] = GetParam();
  UsbCapture capture(endian, long_head);
  capture.at(kStart).device(3).in(1, "a memory stick").device(5);
  capture.at(kStart + 10).control(0x21, 0x20, 0, 0, CaptureBytes().u32(19'200).u8(0).u8(2).u8(7).str());
  capture.at(kStart + 20).control(0x21, 0x22, 0, 0).at(kStart + 30).control(0x21, 0x22, 3, 0);
  capture.at(kStart + 40).out(2, "AT\r").at(kStart + 50).in(1, "OK\r\n");
  capture.at(kStart + 60).interrupt(3, "\xa1\x20\0\0\0\0\x02\0\x03\0"s);
  capture.at(kStart + 70).control(0x21, 0x23, 250, 0).at(kStart + 400'000).out(2, "x");
  capture.at(kStart + 400'001).device(3).out(1, "to the stick");
  const auto made = read(capture.str());
  EXPECT_THAT(
      lines_of(made),
      ElementsAre(
          R"({"t_us":0,"event":"open"})",
          R"({"t_us":0,"event":"settings","by":"driver","baud":19200,"databits":7,"parity":"even","stopbits":1,"order":"exact"})",
          modem(10, "dtr", "off", "driver"), modem(10, "rts", "off", "driver"),
          modem(20, "dtr", "on", "driver"), modem(20, "rts", "on", "driver"), R"(w 30 AT\r)",
          R"(r 40 OK\r\n)", modem(50, "dsr", "on", "device"), modem(50, "cd", "on", "device"),
          modem(50, "ri", "off", "device"), R"({"t_us":60,"event":"break","state":"on","by":"driver"})",
          R"({"t_us":250060,"event":"break","state":"off","by":"driver"})", "w 399990 x"));
  EXPECT_THAT(made->problems, ElementsAre());
}

INSTANTIATE_TEST_SUITE_P(Each, UsbHeads,
                         testing::Combine(testing::Values(Endian::little, Endian::big), testing::Bool()));

TEST_F(UsbmonFormatTest, EqualTimesKeepTheOrder) {
  UsbCapture capture;
  capture.at(kStart).device(5).control(0x21, 0x22, 3, 0);
  capture.at(kStart + 5).out(2, "A1").in(1, "a1").out(2, "B2").in(1, "b2");
  EXPECT_THAT(lines_of(read(capture.str())), testing::IsSupersetOf({"w 5 A1", "r 5 a1", "w 6 B2", "r 6 b2"}));
}

TEST_F(UsbmonFormatTest, FtdiStatusBytesAreTakenOut) {
  UsbCapture capture;
  capture.at(kStart).descriptor(0x0403, 0x0600);
  capture.at(kStart + 5)
      .control(0x40, 0, 0, 0)
      .at(kStart + 10)
      .control(0x40, 3, 0x4138, 0)
      .control(0x40, 4, 0x0208, 0);
  capture.at(kStart + 20).control(0x40, 1, 0x0100, 0).control(0x40, 2, 0, 0x0100);
  capture.at(kStart + 30).control(0x40, 0, 1, 0).at(kStart + 40).out(2, "hello");
  capture.at(kStart + 50).in(1, "\x01\x60"s);
  capture.at(kStart + 60).in(1, "\x01\x60"s + std::string(62, 'a') + "\x11\x60"s + "bc");
  capture.at(kStart + 70).in(1, "\x11\x70"s).in(1, "\x11\x60"s);
  const auto made = read(capture.str());
  const std::string settings = R"("event":"settings","by":"driver","baud":9600)";
  EXPECT_THAT(
      lines_of(made),
      ElementsAre(
          R"({"t_us":0,"event":"open"})", R"({"t_us":5,)" + settings + R"(,"order":"exact"})",
          R"({"t_us":5,)" + settings + R"(,"databits":8,"parity":"even","stopbits":1,"order":"exact"})",
          modem(15, "dtr", "off", "driver"), HasSubstr(R"("hwflowctrl":true)"),
          R"({"t_us":25,"event":"flush","queue":"in"})", "w 35 hello", modem(45, "cts", "off", "device"),
          modem(45, "dsr", "off", "device"), modem(45, "cd", "off", "device"),
          modem(45, "ri", "off", "device"), modem(55, "cts", "on", "device"),
          "r 55 " + std::string(62, 'a') + "bc", R"({"t_us":65,"event":"break","state":"on","by":"device"})",
          R"({"t_us":65,"event":"break","state":"off","by":"device"})"));
  EXPECT_THAT(made->guesses, ElementsAre());
}

TEST_F(UsbmonFormatTest, FtdiDivisors) {
  const auto baud = [&](unsigned version, unsigned value, unsigned index) {
    const auto made = read(UsbCapture().descriptor(0x0403, version).control(0x40, 3, value, index).str());
    const auto lines = lines_of(made);
    const std::string& line = lines.back();
    const std::size_t at = line.find("\"baud\":");
    return at == std::string::npos ? 0 : std::stoi(line.substr(at + 7));
  };
  // As the kernel's ftdi_sio and libftdi encode them.
  EXPECT_EQ(baud(0x0600, 0x001a, 0), 115'200);
  EXPECT_EQ(baud(0x0600, 0x4138, 0), 9'600);
  EXPECT_EQ(baud(0x0600, 0x809c, 0), 19'200);
  EXPECT_EQ(baud(0x0600, 0x0034, 0), 57'600);
  EXPECT_EQ(baud(0x0600, 0x4006, 0), 460'800);
  EXPECT_EQ(baud(0x0600, 0x0000, 0), 3'000'000);
  EXPECT_EQ(baud(0x0600, 0x0001, 0), 2'000'000);
  EXPECT_EQ(baud(0x0600, 0x2710, 0), 300);
  EXPECT_EQ(baud(0x0700, 0xc068, 0x0201), 115'200);
  EXPECT_EQ(baud(0x0700, 0x0000, 0x0001), 3'000'000);
}

TEST_F(UsbmonFormatTest, FtdiPortsAndKindByItsBytes) {
  UsbCapture capture;
  capture.at(kStart)
      .in(1, "\x01\x60"s)
      .at(kStart + 10)
      .in(3, "\x01\x60second"s)
      .at(kStart + 20)
      .in(1,
          "\x01\x60"
          "first"s);
  const auto first = read(capture.str());
  EXPECT_THAT(first->guesses, ElementsAre(HasSubstr("device 1.5 is a serial adapter of kind ftdi")));
  EXPECT_THAT(lines_of(first), testing::AllOf(testing::Contains("r 20 first"),
                                              testing::Not(testing::Contains(HasSubstr("second")))));
  EXPECT_THAT(lines_of(read(capture.str(), "1.5,ftdi,port=2")), testing::Contains(HasSubstr("second")));
}

TEST_F(UsbmonFormatTest, Cp210x) {
  UsbCapture capture;
  capture.at(kStart).control(0x41, 0x00, 1, 0).control(0x41, 0x1e, 0, 0, CaptureBytes().u32(460'800).str());
  capture.at(kStart + 10)
      .control(0x41, 0x03, 0x0810, 0)
      .control(0x41, 0x07, 0x0302, 0)
      .control(0xc1, 0x08, 0, 0, "\x31"s);
  capture.at(kStart + 20)
      .control(0x41, 0x05, 1, 0)
      .at(kStart + 30)
      .control(0x41, 0x05, 0, 0)
      .control(0x41, 0x12, 0x0f, 0);
  capture.control(0x41, 0x13, 0, 0, "\x08\0\0\0\x03\0\0\0\0\0\0\0\0\0\0\0"s);
  capture.at(kStart + 40).out(1, "w").at(kStart + 50).in(1, "r").at(kStart + 60).control(0x41, 0x00, 0, 0);
  EXPECT_THAT(lines_of(read(capture.str())),
              ElementsAre(HasSubstr("open"), HasSubstr(R"("baud":460800,"order")"),
                          HasSubstr(R"("baud":460800,"databits":8,"parity":"odd","stopbits":1)"),
                          modem(10, "dtr", "off", "driver"), modem(10, "cts", "on", "device"),
                          modem(10, "dsr", "on", "device"), modem(10, "cd", "off", "device"),
                          modem(10, "ri", "off", "device"), HasSubstr(R"("break","state":"on")"),
                          HasSubstr(R"("break","state":"off")"), HasSubstr(R"("queue":"both")"),
                          HasSubstr(R"("hwflowctrl":true,"swflowctrl":true)"), "w 40 w", "r 50 r",
                          R"({"t_us":60,"event":"close"})"));
}

TEST_F(UsbmonFormatTest, Pl2303) {
  UsbCapture capture;
  capture.at(kStart).descriptor(0x067b).control(0x40, 0x01, 0x0808, 0);
  capture.at(kStart + 10).control(0x21, 0x20, 0, 0, CaptureBytes().u32(4800).u8(2).u8(1).u8(8).str());
  capture.at(kStart + 20).interrupt(1, "\xa1\x20\0\0\0\0\x02\0\x82\0"s).at(kStart + 30).in(3, "$GPGGA");
  EXPECT_THAT(
      lines_of(read(capture.str())),
      ElementsAre(HasSubstr("open"), HasSubstr(R"("baud":4800,"databits":8,"parity":"odd","stopbits":2)"),
                  modem(10, "cts", "on", "device"), modem(10, "dsr", "on", "device"),
                  modem(10, "cd", "off", "device"), modem(10, "ri", "off", "device"), "r 20 $GPGGA"));
}

TEST_F(UsbmonFormatTest, AModemIsKnownByTheInterfacesOfItsConfiguration) {
  const auto capture_of = [](unsigned subclass) {
    UsbCapture capture;
    capture.at(kStart).control(
        0x80, 6, 0x0200, 0,
        CaptureBytes().u8(9).u8(2).u16(25).u8(1).u8(1).u8(0).u8(0x80).u8(50).str() +
            CaptureBytes().u8(9).u8(4).u8(0).u8(0).u8(1).u8(2).u8(subclass).u8(1).u8(0).str() +
            CaptureBytes().u8(7).u8(5).u8(0x83).u8(2).u16(64).u8(0).str());
    capture.at(kStart + 10).in(3, "hello");
    return capture.str();
  };
  const auto modem = read(capture_of(2));
  ASSERT_TRUE(modem) << modem.error().message;
  EXPECT_THAT(lines_of(modem), testing::Contains("r 0 hello"));
  EXPECT_THAT(modem->guesses, ElementsAre());
  EXPECT_THAT(read(capture_of(6)).error().message, HasSubstr("With bulk transfers: 1.5")) << "Ethernet";
}

TEST_F(UsbmonFormatTest, WhatIsNotKnownIsAskedFor) {
  UsbCapture capture;
  capture.at(kStart).in(1, "hello").device(7).out(2, "there");
  EXPECT_THAT(read(capture.str()).error().message, HasSubstr("With bulk transfers: 1.5, 1.7"));
  const auto named = read(capture.str(), "1.5");
  EXPECT_THAT(lines_of(named), testing::Contains("r 0 hello"));
  EXPECT_THAT(named->guesses, ElementsAre(HasSubstr("kind cdc, which nothing tells")));
  EXPECT_THAT(read(capture.str(), "1.5,cp210x")->guesses, ElementsAre());
  EXPECT_THAT(read(capture.str(), "ttyUSB0").error().message, HasSubstr("'ttyUSB0' is wrong"));
  const auto torn = read(capture.str().substr(0, capture.str().size() - 3), "1.5");
  EXPECT_THAT(torn->problems, ElementsAre(HasSubstr("it ends within")));
}

}  // namespace
}  // namespace porttape
