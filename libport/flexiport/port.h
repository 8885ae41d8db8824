#ifndef FLEXIPORT_PORT_H_
#define FLEXIPORT_PORT_H_

#include <flexiport/flexiport.h>
#include <flexiport/flexiport_types.h>
#include <flexiport/timeout.h>
#include <map>
#include <string>

namespace flexiport {

// One end of a line, for calls that wait. Every function may throw PortException; README.md of this folder
// has the return values.
//
// Threads: beside one thread that reads (Read and its like, Skip, BytesAvailable) another one may write
// (Write and its like, Drain). Neither waits for the other; each call has the timeout that was set when it
// began. Flush, SetTimeout, SetCanRead, SetCanWrite, the functions that only ask, and SerialPort's
// SetBaudRate may be called meanwhile, from any thread. So may Close, which ends the calls that wait. Not
// safe: deleting the port before every call has returned, and SetDebug or GetBaudRate beside a thread that
// sets the same. README.md tells what else to know, of two readers or two writers too. All of this holds for
// the ports of this library.
//
// Programs that were built before rely on the order of the virtual functions and of the data members.
class FLEXIPORT_EXPORT Port {
 public:
  virtual ~Port();

  virtual void Open() = 0;
  virtual void Close() = 0;

  virtual ssize_t Read(void* const buffer, size_t count) = 0;
  virtual ssize_t ReadFull(void* const buffer, size_t count) = 0;
  virtual ssize_t ReadString(std::string& buffer);
  virtual ssize_t ReadUntil(void* const buffer, size_t count, uint8_t terminator);
  virtual ssize_t ReadStringUntil(std::string& buffer, char terminator);
  virtual ssize_t ReadLine(char* const buffer, size_t count);
  virtual ssize_t ReadLine(std::string& buffer);
  virtual ssize_t Skip(size_t count);
  virtual ssize_t SkipUntil(uint8_t terminator, unsigned int count);
  virtual ssize_t BytesAvailable() = 0;
  virtual ssize_t BytesAvailableWait() = 0;

  virtual ssize_t Write(const void* const buffer, size_t count) = 0;
  virtual ssize_t WriteFull(const void* const buffer, size_t count);
  virtual ssize_t WriteString(const char* const buffer);
  virtual ssize_t WriteString(const std::string& buffer);

  virtual void Flush() = 0;
  virtual void Drain() = 0;

  virtual std::string GetStatus() const;
  std::string GetPortType() const { return _type; }
  void SetDebug(unsigned int debug) { _debug = debug; }
  unsigned int GetDebug() const { return _debug; }

  virtual void SetTimeout(Timeout timeout);
  virtual Timeout GetTimeout() const;
  virtual bool IsBlocking() const;
  virtual void SetCanRead(bool canRead);
  virtual bool CanRead() const;
  virtual void SetCanWrite(bool canWrite);
  virtual bool CanWrite() const;
  virtual bool IsOpen() const = 0;

 protected:
  std::string _type;
  unsigned int _debug;
  Timeout _timeout;
  bool _canRead;
  bool _canWrite;
  bool _alwaysOpen;

  Port();
  Port(unsigned int debug, Timeout timeout, bool canRead, bool canWrite, bool alwaysOpen);

  // Hands each option but `type` to ProcessOption; throws for one that it does not take.
  void ProcessOptions(const std::map<std::string, std::string>& options);
  // Takes the options of all ports. False: not one of them.
  virtual bool ProcessOption(const std::string& option, const std::string& value);
  // Throws unless the port is open and may be read from, or written to.
  virtual void CheckPort(bool read);

 private:
  Port(const Port& rhs);
  void operator=(const Port& rhs);
};

}  // namespace flexiport

#endif
