// The driver under test.
#pragma once

#include <fcntl.h>
#include <string>
#include <unistd.h>

inline std::string ask(const std::string& port, const std::string& question) {
  const int fd = ::open(port.c_str(), O_RDWR | O_NOCTTY);
  std::string answer(3, '\0');
  const bool asked = ::write(fd, question.data(), question.size()) > 0;
  const ssize_t size = asked ? ::read(fd, answer.data(), answer.size()) : 0;
  answer.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  ::close(fd);
  return answer;
}
