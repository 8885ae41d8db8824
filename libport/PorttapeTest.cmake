# porttape_add_test(NAME name TAPE tape COMMAND command [argument…]
#                   [DRIVER port] [RULES file] [STRICTNESS 0|1|2] [TIMEOUT seconds] [WORKING_DIRECTORY folder]
#                   [ARGS option…])
#
# A test of CTest: `command` runs with the tape in its device's place, and the verdict is the test's. `{port}` among its
# arguments is what it is to open (also PORTTAPE_PORT in its environment); `command` may be a target that was made before.
# TAPE and RULES are relative to the source folder, and a command such as ./driver if it is there. ARGS are further options
# of `porttape test`. What else a test can have (ENVIRONMENT, DISABLED, WILL_FAIL, LABELS) it gets by
# set_tests_properties, as any. Call enable_testing() before.
function(porttape_add_test)
  cmake_parse_arguments(PARSE_ARGV 0 arg "" "NAME;TAPE;DRIVER;RULES;STRICTNESS;TIMEOUT;WORKING_DIRECTORY" "COMMAND;ARGS")
  if(DEFINED arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "porttape_add_test: '${arg_UNPARSED_ARGUMENTS}' is too much; options of porttape test stand behind ARGS")
  endif()
  foreach(_word NAME TAPE COMMAND)
    if(NOT DEFINED arg_${_word})
      message(FATAL_ERROR "porttape_add_test: ${_word} is missing; write porttape_add_test(NAME laser TAPE laser COMMAND driver {port})")
    endif()
  endforeach()
  get_filename_component(_tape "${arg_TAPE}" ABSOLUTE)
  set(_options --tape "${_tape}" --color never)
  if(DEFINED arg_RULES)
    get_filename_component(_rules "${arg_RULES}" ABSOLUTE)
    list(APPEND _options --rules "${_rules}")
  endif()
  foreach(_word DRIVER STRICTNESS TIMEOUT)
    if(DEFINED arg_${_word})
      string(TOLOWER ${_word} _option)
      list(APPEND _options --${_option} "${arg_${_word}}")
    endif()
  endforeach()
  list(POP_FRONT arg_COMMAND _command)
  if(TARGET "${_command}")
    set(_command "$<TARGET_FILE:${_command}>")
  elseif(_command MATCHES "/" AND EXISTS "${CMAKE_CURRENT_SOURCE_DIR}/${_command}")
    set(_command "${CMAKE_CURRENT_SOURCE_DIR}/${_command}")
  endif()
  set(_folder)
  if(DEFINED arg_WORKING_DIRECTORY)
    set(_folder WORKING_DIRECTORY "${arg_WORKING_DIRECTORY}")
  endif()
  add_test(NAME "${arg_NAME}" COMMAND $<TARGET_FILE:Porttape::tool> test ${_options} ${arg_ARGS} -- "${_command}" ${arg_COMMAND}
    ${_folder})
  # CTest's own limit, in whole seconds, is for what the tool cannot end.
  if(DEFINED arg_TIMEOUT AND arg_TIMEOUT GREATER 0)
    string(REGEX REPLACE "[.].*" "" _limit "0${arg_TIMEOUT}")
    math(EXPR _limit "${_limit} + 60" OUTPUT_FORMAT DECIMAL)
    set_tests_properties("${arg_NAME}" PROPERTIES TIMEOUT ${_limit})
  endif()
endfunction()
