# Fails when a source of the product reads a clock of the system, or asks for the machine's clock, anywhere but in the
# clock's own files and the places of this list. Everything else asks the loop that it runs on (libport/base/clock.hpp).
cmake_minimum_required(VERSION 3.25)

set(own_files libport/base/clock.hpp libport/base/clock.cpp)
set(places
  # A loop that is given no clock has the machine's.
  libport/loop/loop.hpp
  # How long a job has waited for a thread of this machine.
  libport/base/workers.cpp
  # How long a disk takes, and when it is to be synced.
  libport/tape/live_tape.cpp
  # The date on which a file was made: verbs that make tapes have no loop.
  libport/tape/tape_header.cpp
  # How long looks at a program's threads take.
  libport/supervise/kept_calls.cpp
  # How long the reader of a report's pipe may take.
  libport/taped/report_file.cpp
  # How long a UART takes to send what is left.
  libport/tty/tty.cpp
  # flexiport's LogFile has no loop: its caller waits in it, by real time.
  libport/flexiport/logfile.cpp
  # The waits and durations of verbs.
  tools/verb_clock.cpp)
set(most 10)

set(reads "_clock::now|clock_gettime|gettimeofday|[^a-z_]time\\((nullptr|NULL|0|&)|= *std::chrono::[a-z_]+_clock;|[cC]lock::now\\(|machine_clock\\(\\)|timespec_get|[^r]ftime\\(")

set(wrong 0)
set(seen 0)
set(used "")
foreach(folder IN ITEMS libport tools daemon)
  file(GLOB_RECURSE files ${ROOT}/${folder}/*.hpp ${ROOT}/${folder}/*.cpp ${ROOT}/${folder}/*.h)
  foreach(file IN LISTS files)
    math(EXPR seen "${seen} + 1")
    file(RELATIVE_PATH name ${ROOT} ${file})
    file(STRINGS ${file} lines REGEX "${reads}")
    list(FILTER lines EXCLUDE REGEX "^ *//")
    if(NOT lines OR name IN_LIST own_files)
      continue()
    endif()
    if(name IN_LIST places)
      list(APPEND used ${name})
      continue()
    endif()
    message(SEND_ERROR "${name} reads a clock of the system: ${lines}\n"
      "Ask the loop (Loop::now(), Loop::clock()); a verb's own waits ask verb_clock().")
    set(wrong 1)
  endforeach()
endforeach()

list(LENGTH places count)
if(count GREATER most)
  message(SEND_ERROR "${count} places may read a clock of the system; ${most} are the most")
  set(wrong 1)
endif()
foreach(place IN LISTS places)
  if(NOT place IN_LIST used)
    message(SEND_ERROR "${place} reads no clock of the system any more: take it off the list")
    set(wrong 1)
  endif()
endforeach()
if(seen EQUAL 0)
  message(FATAL_ERROR "no source was found under ${ROOT}")
endif()
if(NOT wrong)
  message(STATUS "${seen} files; besides the clock itself, ${count} of at most ${most} places read a clock of the system")
endif()
