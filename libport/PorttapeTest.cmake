# porttape_add_test(NAME name TAPE tape COMMAND command [argument…]
#                   [DRIVER port] [RULES file] [STRICTNESS 0|1|2] [TIMEOUT seconds] [WORKING_DIRECTORY folder]
#                   [ARGS option…])
#
# A test of CTest: `command` runs with the tape in its device's place, and the verdict is the test's. `{port}` among its
# arguments is what it is to open (also PORTTAPE_PORT in its environment); `command` may be a target that was made before.
# TAPE and RULES are relative to the source folder, and a command such as ./driver if it is there. ARGS are further options
# of `porttape test`. What else a test can have (ENVIRONMENT, DISABLED, WILL_FAIL, LABELS) it gets by
# set_tests_properties, as any. Call enable_testing() before.
#
# Every value arrives as it is written, also with semicolons, spaces, quotes and backslashes in it; `$<...>` is a generator
# expression, as in any add_test.

# A word as a bracket argument of CMake's code, with a space before it: a list would lose it if it is empty, and split it at its
# semicolons.
function(_porttape_argument _result _word)
  set(_equals "=")
  while("${_word}]" MATCHES "]${_equals}]")
    string(APPEND _equals "=")
  endwhile()
  set(${_result} " [${_equals}[\n${_word}]${_equals}]" PARENT_SCOPE)  # the first newline is none of it
endfunction()

# A path from the source folder on. get_filename_component would make slashes of its backslashes.
function(_porttape_path _result _path)
  if("${_path}" MATCHES "^~/")
    string(SUBSTRING "${_path}" 1 -1 _path)
    set(_path "$ENV{HOME}${_path}")
  elseif(NOT IS_ABSOLUTE "${_path}")
    set(_path "${CMAKE_CURRENT_SOURCE_DIR}/${_path}")
  endif()
  set(${_result} "${_path}" PARENT_SCOPE)
endfunction()

function(porttape_add_test)
  set(_single NAME TAPE DRIVER RULES STRICTNESS TIMEOUT WORKING_DIRECTORY)
  set(_several COMMAND ARGS)
  cmake_parse_arguments(PARSE_ARGV 0 arg "" "${_single}" "${_several}")
  if(DEFINED arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "porttape_add_test: '${arg_UNPARSED_ARGUMENTS}' is too much; options of porttape test stand behind ARGS")
  endif()
  foreach(_word NAME TAPE COMMAND)
    if(NOT DEFINED arg_${_word})
      message(FATAL_ERROR "porttape_add_test: ${_word} is missing; write porttape_add_test(NAME laser TAPE laser COMMAND driver {port})")
    endif()
  endforeach()
  foreach(_word TAPE RULES)
    if(DEFINED arg_${_word})
      _porttape_path(arg_${_word} "${arg_${_word}}")
    endif()
  endforeach()
  set(_options)
  foreach(_word TAPE RULES DRIVER STRICTNESS TIMEOUT)
    if(DEFINED arg_${_word})
      string(TOLOWER ${_word} _option)
      _porttape_argument(_value "${arg_${_word}}")
      string(APPEND _options " --${_option}${_value}")
    endif()
  endforeach()
  # The words of COMMAND and ARGS one by one.
  set(_code_COMMAND)
  set(_code_ARGS)
  set(_key)
  math(EXPR _last "${ARGC} - 1")
  foreach(_i RANGE ${_last})
    set(_word "${ARGV${_i}}")
    if("${_word}" IN_LIST _single OR "${_word}" IN_LIST _several)
      set(_key "${_word}")
      continue()
    endif()
    if(NOT "${_key}" IN_LIST _several)
      continue()
    endif()
    if("${_key}" STREQUAL "COMMAND" AND "${_code_COMMAND}" STREQUAL "")
      if(TARGET "${_word}")
        set(_word "$<TARGET_FILE:${_word}>")
      elseif(_word MATCHES "/" AND EXISTS "${CMAKE_CURRENT_SOURCE_DIR}/${_word}")
        set(_word "${CMAKE_CURRENT_SOURCE_DIR}/${_word}")
      endif()
    endif()
    _porttape_argument(_value "${_word}")
    string(APPEND _code_${_key} "${_value}")
  endforeach()
  set(_folder)
  if(DEFINED arg_WORKING_DIRECTORY)
    _porttape_argument(_value "${arg_WORKING_DIRECTORY}")
    set(_folder "WORKING_DIRECTORY${_value}")
  endif()
  cmake_language(EVAL CODE "add_test(NAME \"\${arg_NAME}\" COMMAND $<TARGET_FILE:Porttape::tool> test --color never
    ${_options} ${_code_ARGS} -- ${_code_COMMAND} ${_folder})")
  # CTest's own limit, in whole seconds, is for what the tool cannot end.
  if(DEFINED arg_TIMEOUT AND arg_TIMEOUT GREATER 0)
    string(REGEX REPLACE "[.].*" "" _limit "0${arg_TIMEOUT}")
    math(EXPR _limit "${_limit} + 60" OUTPUT_FORMAT DECIMAL)
    set_tests_properties("${arg_NAME}" PROPERTIES TIMEOUT ${_limit})
  endif()
endfunction()
