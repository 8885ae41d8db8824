#ifndef FLEXIPORT_LOGFILE_H_
#define FLEXIPORT_LOGFILE_H_

#include <flexiport/flexiport.h>
#include <flexiport/timeout.h>
#include <string>

namespace flexiport {

struct Tape;

// A tape, to be read or written: NAMEr and NAMEw. Time starts at Open() and again at ResetFile(). Throws
// PortException: the tape cannot be opened, is damaged, is not open, or is open for the other use.
class FLEXIPORT_EXPORT LogFile {
 public:
  explicit LogFile(unsigned int debug);
  ~LogFile();

  // `read`: plays a tape; else makes a new one, or replaces an old one. `ignoreTimes`: all is readable at
  // once.
  void Open(const std::string& fileName, bool read, bool ignoreTimes = false);
  void Close();
  bool IsOpen() const;
  void ResetFile();

  // What is due of what was read from the device, else what comes within the timeout: bytes; -1 timeout; 0 at
  // the end.
  ssize_t Read(void* data, size_t count, Timeout& timeout);
  // Bytes that such a Read would give at most; 0 when there are none.
  ssize_t BytesAvailable(const Timeout& timeout);
  // Whether the next recorded written bytes are these; with a timeout also whether they are not written more
  // than it too early. `written` becomes the number of bytes that are right.
  bool CheckWrite(const void* const data, const size_t count, size_t* const written,
                  const Timeout* const timeout = NULL);
  void Flush();
  void Drain();

  void WriteRead(const void* const data, size_t count);
  void WriteWrite(const void* const data, size_t count);

 private:
  LogFile(const LogFile& rhs);
  void operator=(const LogFile& rhs);

  Tape* _tape;
  unsigned int _debug;
};

}  // namespace flexiport

#endif
