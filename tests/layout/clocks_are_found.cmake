# Each way to read a clock of the system, planted in a copy of the product's folders, is found by check_clocks.cmake.
cmake_minimum_required(VERSION 3.25)

file(REMOVE_RECURSE ${WORK})
foreach(folder IN ITEMS libport tools daemon)
  file(COPY ${ROOT}/${folder} DESTINATION ${WORK} FILES_MATCHING PATTERN "*.hpp" PATTERN "*.cpp")
endforeach()

# passes(EXPECTED): whether the check's outcome on the copy is that.
function(check expected what)
  execute_process(COMMAND ${CMAKE_COMMAND} -DROOT=${WORK} -P ${CMAKE_CURRENT_LIST_DIR}/check_clocks.cmake
    RESULT_VARIABLE result OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(expected STREQUAL pass AND NOT result EQUAL 0)
    message(FATAL_ERROR "the product as it is: ${said}")
  elseif(expected STREQUAL fail AND (result EQUAL 0 OR NOT said MATCHES "planted.cpp reads a clock"))
    message(FATAL_ERROR "not found: ${what}")
  endif()
endfunction()

check(pass "")
foreach(read IN ITEMS
    "auto t = std::chrono::steady_clock::now()"
    "auto t = std::chrono::system_clock::now()"
    "auto t = Instant::clock::now()"
    "using Any = std::chrono::steady_clock"
    "auto t = machine_clock().now()"
    "const Clock& c = machine_clock() "
    "::clock_gettime(CLOCK_MONOTONIC, &ts)"
    "::gettimeofday(&tv, nullptr)"
    "auto t = std::time(nullptr)"
    "auto t = ::time(&seconds)")
  file(WRITE ${WORK}/libport/session/planted.cpp "${read};\n")
  check(fail "${read}")
endforeach()
file(WRITE ${WORK}/libport/session/planted.cpp "// machine_clock().now() is only named here\n")
check(pass "")
file(REMOVE_RECURSE ${WORK})
