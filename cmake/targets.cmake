# multipanda_library(NAME [SHARED] SOURCES ... DEPS ...): a library of ours; include path = folder path.
# multipanda_test(NAME SOURCES ... DEPS ... [LABELS ...]): a GoogleTest program; fails to configure without sources.
include(GoogleTest)

# Most of a file's compile time is reading Eigen, the standard library and GoogleTest. With MULTIPANDA_PCH (set by the
# presets) they are read once, for libraries and for tests. Without it every file must name what it uses: develop so.
if(MULTIPANDA_PCH)
  set(MULTIPANDA_PCH_HEADERS <algorithm> <array> <atomic> <cmath> <filesystem> <functional> <future> <map> <memory>
      <optional> <random> <span> <stdexcept> <string> <thread> <vector> <Eigen/Core> <Eigen/Geometry>)
  file(WRITE ${CMAKE_BINARY_DIR}/pch.cpp "")
  add_library(multipanda_pch STATIC ${CMAKE_BINARY_DIR}/pch.cpp)
  target_link_libraries(multipanda_pch PRIVATE multipanda_flags Eigen3::Eigen)
  target_precompile_headers(multipanda_pch PRIVATE ${MULTIPANDA_PCH_HEADERS})
  # A program, as the tests are: precompiled headers of libraries (-fPIC) and programs (-fPIE) do not fit each other.
  add_executable(multipanda_test_pch EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/pch.cpp)
  target_link_libraries(multipanda_test_pch PRIVATE multipanda_flags Eigen3::Eigen GTest::gtest_main)
  target_compile_options(multipanda_test_pch PRIVATE $<$<CONFIG:Release>:-O1>)
  target_precompile_headers(multipanda_test_pch PRIVATE ${MULTIPANDA_PCH_HEADERS} <gtest/gtest.h>)
endif()

function(multipanda_library name)
  cmake_parse_arguments(ARG "SHARED" "" "SOURCES;DEPS;PRIVATE_DEPS;HEAVY" ${ARGN})
  set(kind STATIC)
  if(ARG_SHARED)
    set(kind SHARED)
  endif()
  add_library(${name} ${kind} ${ARG_SOURCES} ${ARG_HEAVY})
  add_library(multipanda::${name} ALIAS ${name})
  # HEAVY: files that only wrap Pinocchio. Undefined-behaviour checks in its templates cost minutes and gigabytes each.
  if(ARG_HEAVY AND MULTIPANDA_SANITIZER MATCHES "address|undefined")
    set_source_files_properties(${ARG_HEAVY} PROPERTIES COMPILE_OPTIONS -fno-sanitize=undefined)
  endif()
  # Pinocchio asserts where a state is not finite; here that must come out as a number that is not, which the safety
  # stage answers, in every build.
  if(ARG_HEAVY)
    set_source_files_properties(${ARG_HEAVY} PROPERTIES COMPILE_DEFINITIONS "$<$<NOT:$<CONFIG:Release>>:NDEBUG>")
  endif()
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${CMAKE_SOURCE_DIR}>)
  target_link_libraries(${name} PUBLIC ${ARG_DEPS} PRIVATE multipanda_flags ${ARG_PRIVATE_DEPS})
  if(MULTIPANDA_PCH)
    target_precompile_headers(${name} REUSE_FROM multipanda_pch)
    set_target_properties(${name} PROPERTIES PCH_WARN_INVALID OFF)  # a file of other flags reads them as text
  endif()
endfunction()

# For programs that load the ROS module: it looks names up in its own libraries first (runtime/ros_module.cpp), so no
# variable of a shared library (std::cout, locale ids) may live as a copy in the program.
function(multipanda_without_copies name)
  target_compile_options(${name} PRIVATE -fPIC)
  target_link_options(${name} PRIVATE -Wl,-z,nocopyreloc)
endfunction()

function(multipanda_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS;LABELS" ${ARGN})
  if(NOT ARG_SOURCES)
    message(FATAL_ERROR "multipanda_test(${name}): no sources, the test would be empty and green")
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} multipanda_flags GTest::gtest GTest::gmock GTest::gtest_main)
  # Tests are compiled once and run once: less optimisation halves their build. What they test keeps its own.
  target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
  if(MULTIPANDA_PCH)
    target_precompile_headers(${name} REUSE_FROM multipanda_test_pch)
  endif()
  target_compile_definitions(${name} PRIVATE MULTIPANDA_SOURCE_DIR="${CMAKE_SOURCE_DIR}"
                             MULTIPANDA_BINARY_DIR="${CMAKE_BINARY_DIR}")
  set(properties TIMEOUT 300)
  if(ARG_LABELS)
    list(APPEND properties LABELS "${ARG_LABELS}")
  endif()
  gtest_discover_tests(${name} PROPERTIES ${properties} DISCOVERY_TIMEOUT 60)
endfunction()
