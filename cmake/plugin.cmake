# For users' libraries (docs/writing_a_controllet.md), who get it by find_package(multipanda), and for multipanda itself:
#   multipanda_plugin(NAME SOURCES...)
# builds a library that the program can load. It carries the hash of the headers it was compiled with; the program
# refuses a library whose hash differs from its own.
include(${CMAKE_CURRENT_LIST_DIR}/shared_headers.cmake)
if(NOT DEFINED MULTIPANDA_HEADERS)  # otherwise defined in multipandaConfig.cmake
  get_filename_component(MULTIPANDA_HEADERS "${CMAKE_CURRENT_LIST_DIR}" DIRECTORY)
endif()
set(MULTIPANDA_HASH_SCRIPT "${CMAKE_CURRENT_LIST_DIR}/headers_hash.cmake")

# Gives the target the header "multipanda_headers_hash.hpp", written again whenever a shared header changes.
function(multipanda_headers_hash target)
  set(folder "${CMAKE_CURRENT_BINARY_DIR}/${target}_headers")
  set(header "${folder}/multipanda_headers_hash.hpp")
  multipanda_shared_headers(headers "${MULTIPANDA_HEADERS}" CONFIGURE_DEPENDS)
  list(TRANSFORM headers PREPEND "${MULTIPANDA_HEADERS}/")
  set(command ${CMAKE_COMMAND} "-DROOT=${MULTIPANDA_HEADERS}" "-DOUTPUT=${header}" -P "${MULTIPANDA_HASH_SCRIPT}")
  add_custom_command(OUTPUT "${header}" COMMAND ${command}
    DEPENDS ${headers} "${MULTIPANDA_HASH_SCRIPT}" COMMENT "" VERBATIM)
  if(NOT EXISTS "${header}")  # tools that read the sources need it before the first build
    execute_process(COMMAND ${command} COMMAND_ERROR_IS_FATAL ANY)
  endif()
  target_sources(${target} PRIVATE "${header}")
  target_include_directories(${target} PRIVATE "${folder}")
endfunction()

function(multipanda_plugin name)
  # No -march, no -mavx: the program refuses a library whose Eigen objects have another alignment.
  add_library(${name} MODULE ${ARGN})
  target_link_libraries(${name} PRIVATE multipanda_core)
  target_compile_features(${name} PRIVATE cxx_std_20)
  set_target_properties(${name} PROPERTIES PREFIX "" CXX_VISIBILITY_PRESET hidden)
  multipanda_headers_hash(${name})
endfunction()
