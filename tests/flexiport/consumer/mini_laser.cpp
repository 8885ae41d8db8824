#include "mini_laser.h"

#include "../../devices/scip_answer.hpp"
#include <cstring>
#include <flexiport/flexiport.h>
#include <flexiport/port.h>
#include <stdexcept>

namespace {

const size_t kLineLength = 256;
const size_t kBlockLength = 66;  // 64 characters, checksum, end of line

}  // namespace

MiniLaser::MiniLaser(const std::string& portOptions) : _port(flexiport::CreatePort(portOptions)) {
  if (!_port->IsOpen()) _port->Open();
}

MiniLaser::~MiniLaser() {
  if (_port->IsOpen()) _port->Close();
  delete _port;
}

void MiniLaser::SendCommand(const std::string& command) {
  _port->Flush();
  const std::string end = "\n";
  if (_port->Write(command.c_str(), command.size()) < static_cast<ssize_t>(command.size()) ||
      _port->Write(end.c_str(), 1) < 1) {
    throw std::runtime_error("the command could not be written");
  }
}

std::string MiniLaser::ReadHeaderLine() {
  char line[kLineLength];
  const ssize_t length = _port->ReadLine(line, sizeof line);
  if (length <= 0) throw std::runtime_error("no answer");
  if (std::strlen(line) != static_cast<size_t>(length)) throw std::runtime_error("a NUL in a line");
  return std::string(line, static_cast<size_t>(length) - 1);
}

// Text up to the empty line.
void MiniLaser::ReadFields(std::vector<std::string>& lines) {
  for (std::string line = ReadHeaderLine(); !line.empty(); line = ReadHeaderLine()) lines.push_back(line);
}

// Blocks of at most 64 characters; a Read may give less than one, and the end in one piece with the last.
void MiniLaser::ReadData(std::vector<std::string>& lines) {
  std::string block;
  for (;;) {
    if (_port->BytesAvailableWait() < 0) throw std::runtime_error("the data ends early");
    char buffer[kBlockLength];
    const size_t wanted = kBlockLength - block.size();
    const ssize_t got = _port->Read(buffer, wanted);
    if (got <= 0) throw std::runtime_error("the data ends early");
    block.append(buffer, static_cast<size_t>(got));
    for (size_t end = block.find('\n'); end != std::string::npos; end = block.find('\n')) {
      if (end == 0) {
        if (block.size() != 1) throw std::runtime_error("something came after the answer");
        return;
      }
      lines.push_back(block.substr(0, end));
      block.erase(0, end + 1);
    }
  }
}

std::string MiniLaser::Ask(const std::string& command) {
  SendCommand(command);
  std::string told;
  for (unsigned left = scip::answers_to(command); left > 0; --left) {
    std::vector<std::string> lines;
    lines.push_back(ReadHeaderLine());
    lines.push_back(ReadHeaderLine());
    if (command.compare(0, 2, "GD") == 0) {
      lines.push_back(ReadHeaderLine());
      ReadData(lines);
    } else if (command == "BM" || command == "QT" || command.compare(0, 2, "CR") == 0) {
      if (_port->SkipUntil('\n', 1) != 1) throw std::runtime_error("the answer is too long");
    } else {
      ReadFields(lines);
    }
    told += scip::describe(command, scip::parse(command, lines));
  }
  return told;
}
