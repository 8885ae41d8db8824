#ifndef MINI_LASER_H_
#define MINI_LASER_H_

#include <string>
#include <vector>

namespace flexiport {
class Port;
}

// A laser driver library in the manner of those written for flexiport. Throws std::exception.
class MiniLaser {
 public:
  explicit MiniLaser(const std::string& portOptions);
  ~MiniLaser();

  // Sends one SCIP command and gives its answer as text.
  std::string Ask(const std::string& command);

 private:
  MiniLaser(const MiniLaser&);
  void operator=(const MiniLaser&);

  void SendCommand(const std::string& command);
  std::string ReadHeaderLine();
  void ReadData(std::vector<std::string>& lines);
  void ReadFields(std::vector<std::string>& lines);

  flexiport::Port* _port;
};

#endif
