#ifndef FLEXIPORT_BACKEDPORT_H_
#define FLEXIPORT_BACKEDPORT_H_

#include <flexiport/port.h>

namespace flexiport {

struct Backing;

// What the ports of this library have in common: each stands on a porttape::BlockingPort, which the backing
// owns. Not to be used by itself.
class FLEXIPORT_EXPORT BackedPort : public Port {
 public:
  virtual ~BackedPort();

  virtual void Open();
  virtual void Close();
  virtual ssize_t Read(void* const buffer, size_t count);
  virtual ssize_t ReadFull(void* const buffer, size_t count);
  virtual ssize_t ReadString(std::string& buffer);
  virtual ssize_t ReadUntil(void* const buffer, size_t count, uint8_t terminator);
  virtual ssize_t ReadStringUntil(std::string& buffer, char terminator);
  virtual ssize_t ReadLine(char* const buffer, size_t count);
  virtual ssize_t ReadLine(std::string& buffer);
  virtual ssize_t Skip(size_t count);
  virtual ssize_t SkipUntil(uint8_t terminator, unsigned int count);
  virtual ssize_t BytesAvailable();
  virtual ssize_t BytesAvailableWait();
  virtual ssize_t Write(const void* const buffer, size_t count);
  virtual ssize_t WriteFull(const void* const buffer, size_t count);
  virtual void Flush();
  virtual void Drain();
  virtual std::string GetStatus() const;
  virtual void SetTimeout(Timeout timeout);
  virtual void SetCanRead(bool canRead);
  virtual void SetCanWrite(bool canWrite);
  virtual bool IsOpen() const;

 protected:
  // `name` is what GetPortType() gives, `type` the type of the porttape port.
  BackedPort(const std::string& name, const std::string& type,
             const std::map<std::string, std::string>& options);

  virtual bool ProcessOption(const std::string& option, const std::string& value);
  virtual void CheckPort(bool read);

  Backing* _backing;

 private:
  bool derived() const;
};

}  // namespace flexiport

#endif
