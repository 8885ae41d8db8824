// Written from flexiport's public documentation alone: `api_program PART FOLDER`, PART one of serial, tcp,
// udp, log (seriallog and logreader), tcplog. Says what is wrong and ends with status 1.

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <flexiport/config.h>
#include <flexiport/flexiport.h>
#include <flexiport/flexiport_types.h>
#include <flexiport/logfile.h>
#include <flexiport/logreaderport.h>
#include <flexiport/logwriterport.h>
#include <flexiport/port.h>
#include <flexiport/serialport.h>
#include <flexiport/tcpport.h>
#include <flexiport/timeout.h>
#include <flexiport/udpport.h>
#include <memory>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

namespace {

typedef std::unique_ptr<flexiport::Port> PortPointer;

#define CHECK(condition) check((condition), #condition, __LINE__)

void check(bool right, const char* what, int line) {
  if (right) return;
  std::fprintf(stderr, "line %d: not so: %s\n", line, what);
  std::exit(1);
}

PortPointer create(const std::string& options) { return PortPointer(flexiport::CreatePort(options)); }

template <class Call>
std::string thrown(Call call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  return std::string();
}

// The far end of a serial line.
class Device {
 public:
  Device() : _fd(posix_openpt(O_RDWR | O_NOCTTY)) {
    CHECK(grantpt(_fd) == 0 && unlockpt(_fd) == 0);
    // Held open, so that the port may close and open.
    _slave = open(ptsname(_fd), O_RDWR | O_NOCTTY);
  }
  ~Device() {
    close(_slave);
    close(_fd);
  }
  std::string Name() const { return ptsname(_fd); }
  void Send(const std::string& text) { CHECK(write(_fd, text.data(), text.size()) == ssize_t(text.size())); }
  std::string Receive(size_t count) {
    std::string text(count, '?');
    for (size_t got = 0; got < count;) {
      const ssize_t n = read(_fd, &text[got], count - got);
      CHECK(n > 0);
      got += size_t(n);
    }
    return text;
  }

 private:
  int _fd;
  int _slave;
};

void Serial(const std::string& folder) {
  Device device;
  PortPointer port =
      create("type=serial,device=" + device.Name() + ",baud=115200,stopbits=1\ttimeout=0.05 hwflowctrl=0");
  CHECK(port->GetPortType() == "serial");
  CHECK(!port->IsOpen() && port->IsBlocking() && port->CanRead() && port->CanWrite());
  char buffer[64];
  CHECK(thrown([&] { port->Read(buffer, 1); }) == "Port is not open.");
  port->Open();
  CHECK(port->IsOpen());
  CHECK(!thrown([&] { port->Open(); }).empty());
  CHECK(port->Read(buffer, sizeof buffer) == -1);
  CHECK(port->BytesAvailable() == 0 && port->BytesAvailableWait() == -1);

  device.Send("hello world\nline two\nbin\x01tail");
  CHECK(port->BytesAvailableWait() > 0);
  CHECK(port->ReadFull(buffer, 5) == 5 && std::memcmp(buffer, "hello", 5) == 0);
  CHECK(port->ReadLine(buffer, sizeof buffer) == 7 && std::strcmp(buffer, " world\n") == 0);
  std::string text;
  CHECK(port->ReadLine(text) == 9 && text == "line two\n");
  CHECK(port->ReadUntil(buffer, sizeof buffer, 1) == 4 && std::memcmp(buffer, "bin\x01", 4) == 0);
  CHECK(port->ReadLine(buffer, 4) == 3 && std::strcmp(buffer, "tai") == 0);
  CHECK(port->ReadStringUntil(text, ';') == -1);
  device.Send(";next");
  CHECK(port->ReadStringUntil(text, ';') == 2 && text == "l;");
  CHECK(port->Skip(2) == 2 && port->SkipUntil('t', 1) == 2);
  CHECK(port->Skip(1) == -1);
  device.Send("all");
  CHECK(port->BytesAvailableWait() == 3 && port->ReadString(text) == 3 && text == "all");

  CHECK(port->Write("abc", 3) == 3 && port->WriteFull("def", 3) == 3);
  CHECK(port->WriteString("ghi") == 3 && port->WriteString(std::string("jkl")) == 3);
  CHECK(device.Receive(12) == "abcdefghijkl");
  port->Drain();
  device.Send("stale");
  CHECK(port->BytesAvailableWait() == 5);
  port->Flush();
  CHECK(port->BytesAvailable() == 0);

  port->SetTimeout(flexiport::Timeout(0, 0));
  CHECK(!port->IsBlocking() && port->Read(buffer, 1) == -1);
  port->SetTimeout(flexiport::Timeout(2, 500));
  CHECK(port->GetTimeout()._sec == 2 && port->GetTimeout()._usec == 500);
  port->SetCanWrite(false);
  CHECK(!thrown([&] { port->Write("x", 1); }).empty());
  port->SetCanRead(false);
  CHECK(!port->CanRead() && !thrown([&] { port->Read(buffer, 1); }).empty());
  CHECK(!port->GetStatus().empty());
  port->SetDebug(3);
  CHECK(port->GetDebug() == 3);
  port->Close();
  CHECK(!port->IsOpen());

  std::map<std::string, std::string> options;
  options["device"] = device.Name();
  flexiport::SerialPort serial(options);
  CHECK(serial.GetBaudRate() == 9600);
  serial.Open();
  serial.SetBaudRate(57600);
  CHECK(serial.GetBaudRate() == 57600);
  serial.Close();

  options["type"] = "seriallog";
  options["file"] = folder + "/settings.log";
  options["baud"] = "19200";
  {
    flexiport::SerialPort logged(options);
    CHECK(logged.GetBaudRate() == 19200);
    logged.Open();
    logged.SetBaudRate(57600);
    CHECK(logged.Write("x", 1) == 1);
  }
  options["type"] = "logreader";
  options.erase("device");
  options.erase("baud");
  flexiport::SerialPort replayed(options);
  replayed.Open();
  replayed.SetBaudRate(57600);
  CHECK(replayed.GetBaudRate() == 57600);
  CHECK(replayed.Write("x", 1) == 1);
}

void Errors() {
  CHECK(thrown([] { create(""); }) == "No options specified. Must specify a port type.");
  CHECK(thrown([] { create(" ,\t\n"); }) == "No options specified. Must specify a port type.");
  const char* const wrong[] = {"timeout=1",
                               "type=teleport",
                               "type=serial,colour=red",
                               "type=serial,timeout=soon",
                               "type=serial,parity=maybe",
                               "type=serial,baud=fast",
                               "type=tcp,port=99999"};
  for (const char* options : wrong) CHECK(!thrown([=] { create(options); }).empty());
  PortPointer missing = create("type=serial,device=/dev/no-such-tty");
  CHECK(!thrown([&] { missing->Open(); }).empty() && !missing->IsOpen());
  PortPointer refused = create("type=tcp,port=1,timeout=1");
  CHECK(!thrown([&] { refused->Open(); }).empty());
}

// Runs `child` in a process of its own and returns its pid.
template <class Call>
pid_t in_child(Call child) {
  const pid_t pid = fork();
  if (pid == 0) {
    const std::string error = thrown(child);
    if (!error.empty()) std::fprintf(stderr, "child: %s\n", error.c_str());
    std::_Exit(error.empty() ? 0 : 1);
  }
  return pid;
}

void wait_for(pid_t pid) {
  int status = 0;
  CHECK(waitpid(pid, &status, 0) == pid && status == 0);
}

// Connects as soon as the other one listens.
void open_patiently(flexiport::Port& port) {
  for (int n = 0; n < 3000 && !thrown([&] { port.Open(); }).empty(); ++n) usleep(20000);
  CHECK(port.IsOpen());
}

std::string number(int value) { return std::to_string(value); }

void Tcp(const std::string& number_of_port) {
  const pid_t server = in_child([&] {
    PortPointer port = create("type=tcp,listen,timeout=60,port=" + number_of_port);
    port->Open();
    std::string line;
    while (port->ReadLine(line) > 0) port->WriteString("echo " + line);
    CHECK(!port->IsOpen());
  });
  {
    PortPointer port = create("type=tcp,ip=127.0.0.1,timeout=60,port=" + number_of_port);
    CHECK(port->GetPortType() == "tcp");
    open_patiently(*port);
    std::string line;
    for (const char* text : {"one\n", "two\n", "three\n"}) {
      port->WriteString(text);
      CHECK(port->ReadLine(line) > 0 && line == std::string("echo ") + text);
    }
    const std::string much(300000, 'x');
    CHECK(port->WriteFull(much.data(), much.size()) == ssize_t(much.size()));
    port->WriteString("\n");
    CHECK(port->ReadLine(line) == ssize_t(much.size()) + 6);
    port->Drain();
    port->SetTimeout(flexiport::Timeout(0, 50000));
    CHECK(port->ReadLine(line) == -1);
  }
  wait_for(server);
}

void Udp(int first) {
  const std::string here =
      "type=udp,timeout=60,dest_ip=127.0.0.1,dest_port=" + number(first) + ",recv_port=" + number(first + 1);
  const std::string there =
      "type=udp,timeout=60,dest_ip=127.0.0.1,dest_port=" + number(first + 1) + ",recv_port=" + number(first);
  PortPointer one = create(here);
  PortPointer two = create(there);
  CHECK(one->GetPortType() == "udp");
  one->Open();
  two->Open();
  CHECK(one->Write("first", 5) == 5 && one->Write("second", 6) == 6);
  char buffer[100];
  CHECK(two->Read(buffer, sizeof buffer) == 5 && std::memcmp(buffer, "first", 5) == 0);
  CHECK(two->Read(buffer, sizeof buffer) == 6 && std::memcmp(buffer, "second", 6) == 0);
  CHECK(two->WriteString("back") == 4);
  CHECK(one->BytesAvailableWait() == 4 && one->ReadFull(buffer, 4) == 4);
  one->SetTimeout(flexiport::Timeout(0, 50000));
  CHECK(one->Read(buffer, 1) == -1);
}

// A question and an answer, twice, on any port.
void Converse(flexiport::Port& port) {
  std::string line;
  for (int n = 0; n < 2; ++n) {
    port.Flush();
    CHECK(port.WriteString("ask " + number(n) + "\n") == 6);
    CHECK(port.ReadLine(line) == 9 && line == "answer " + number(n) + "\n");
  }
}

void answer_twice(Device& device) {
  for (int n = 0; n < 2; ++n) {
    CHECK(device.Receive(6) == "ask " + number(n) + "\n");
    device.Send("answer " + number(n) + "\n");
  }
}

// The tape again, at each strictness.
void Replay(const std::string& file) {
  for (const char* more :
       {"strictness=0", "strictness=1", "strictness=2,jitter=5000", "strictness=1,timing=reactive",
        "strictness=2,timing=reactive,jitter=5000", "ignoretimes", "strictness=2,ignoretimes"}) {
    PortPointer port = create("type=logreader,timeout=60,file=" + file + "," + more);
    CHECK(port->GetPortType() == "logreader");
    port->Open();
    Converse(*port);
    port->SetTimeout(flexiport::Timeout(0, 20000));
    char buffer[1];
    CHECK(port->Read(buffer, 1) == -1);
    port->Close();
  }
  PortPointer loose = create("type=logreader,timeout=60,file=" + file);
  loose->Open();
  CHECK(loose->WriteString("xxx 0\n") == 6);
  PortPointer strict = create("type=logreader,strictness=1,timeout=60,file=" + file);
  strict->Open();
  const std::string error = thrown([&] { strict->WriteString("ask X\n"); });
  CHECK(error.find("expected") != std::string::npos && error.find("byte 4") != std::string::npos);
}

void Log(const std::string& folder) {
  const std::string file = folder + "/serial.log";
  for (int n = 0; n < 2; ++n) {  // the second one replaces the first
    Device device;
    const pid_t answers = in_child([&] { answer_twice(device); });
    {
      PortPointer port = create("type=seriallog,timeout=60,device=" + device.Name() + ",file=" + file);
      CHECK(port->GetPortType() == "logwriter");
      port->Open();
      Converse(*port);
      port->Close();
    }
    wait_for(answers);
  }
  Replay(file);

  flexiport::LogFile tape(0);
  CHECK(!tape.IsOpen());
  tape.Open(file, true, true);
  char buffer[100];
  flexiport::Timeout timeout(1, 0);
  CHECK(tape.BytesAvailable(timeout) == 18 && tape.Read(buffer, sizeof buffer, timeout) == 18);
  CHECK(tape.Read(buffer, sizeof buffer, timeout) == 0);
  size_t written = 0;
  CHECK(tape.CheckWrite("ask 0\nask", 9, &written) && written == 9);
  CHECK(!tape.CheckWrite(" 2", 2, &written) && written == 1);
  tape.Close();
  tape.Open(folder + "/own.log", false);
  tape.WriteWrite("q", 1);
  tape.WriteRead("a", 1);
  tape.Close();
  tape.Open(folder + "/own.log", true);
  CHECK(tape.Read(buffer, 1, timeout) == 1 && buffer[0] == 'a' && tape.CheckWrite("q", 1, &written));
}

void TcpLog(const std::string& folder, const std::string& number_of_port) {
  const std::string file = folder + "/tcp.log";
  const pid_t client = in_child([&] {
    PortPointer port = create("type=tcp,timeout=60,port=" + number_of_port);
    open_patiently(*port);
    std::string line;
    for (int n = 0; n < 2; ++n) {
      CHECK(port->ReadLine(line) == 6 && line == "ask " + number(n) + "\n");
      port->WriteString("answer " + number(n) + "\n");
    }
    CHECK(port->Read(&line[0], 1) == 0);
  });
  {
    PortPointer port = create("type=tcplog,listen,timeout=60,port=" + number_of_port + ",file=" + file);
    port->Open();
    Converse(*port);
  }
  wait_for(client);
  Replay(file);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: api_program serial|errors|tcp|udp|log|tcplog FOLDER PORT\n");
    return 2;
  }
  const std::string part = argv[1];
  const std::string folder = argv[2];
  const std::string port = argv[3];
  const std::string error = thrown([&] {
    if (part == "serial") Serial(folder);
    if (part == "errors") Errors();
    if (part == "tcp") Tcp(port);
    if (part == "udp") Udp(std::atoi(port.c_str()));
    if (part == "log") Log(folder);
    if (part == "tcplog") TcpLog(folder, port);
  });
  if (error.empty()) return 0;
  std::fprintf(stderr, "%s: %s\n", part.c_str(), error.c_str());
  return 1;
}
