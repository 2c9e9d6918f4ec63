# multipanda_library(NAME [SHARED] [OFF_LOOP] SOURCES ... DEPS ...): a library of ours; include path = folder path.
# OFF_LOOP: no loop runs its code, so it is compiled with -O1 and little inlining, in half of the time of -O3.
# multipanda_test(NAME SOURCES ... DEPS ... [FIRST] [SHARDS n] [LABELS ...] [SERIES ...]): a GoogleTest program, which ctest
# runs as one process, or as n that share its cases. FIRST: it belongs to the first tier, `./multipanda test`. SERIES: its
# tests that are long series (core/testing/series.hpp), by name. `ctest -C full`, which is `./multipanda test --long`,
# makes a study of each, on all cores.
add_custom_target(first_tier)
set(MULTIPANDA_OFF_LOOP "$<$<CONFIG:Release>:-O1>"
    "$<$<AND:$<CONFIG:Release>,$<CXX_COMPILER_ID:Clang>>:SHELL:-mllvm -inline-threshold=25>")
set(MULTIPANDA_PROGRAM_LEVEL $<$<CONFIG:Release>:$<IF:$<BOOL:${MULTIPANDA_SIMULATOR}>,-O0,-O1>>)

# Most of a file's compile time goes into Eigen, the standard library, GoogleTest and the headers that nearly all include.
# With MULTIPANDA_PCH (set by the presets) they are parsed once for libraries, programs and tests each.
if(MULTIPANDA_PCH)
  set(MULTIPANDA_PCH_LIBRARIES "")
  if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")  # GCC refuses headers whose definitions a file does not have
    set(MULTIPANDA_PCH_LIBRARIES <fmt/format.h> <fmt/ranges.h> <nlohmann/json.hpp>)
  endif()
  set(MULTIPANDA_PCH_HEADERS <algorithm> <array> <atomic> <chrono> <cmath> <filesystem> <functional> <future> <map>
      <memory> <optional> <random> <span> <stdexcept> <string> <thread> <vector> <Eigen/Core> <Eigen/Geometry>
      ${MULTIPANDA_PCH_LIBRARIES} ${CMAKE_SOURCE_DIR}/core/cycle/backend.hpp
      ${CMAKE_SOURCE_DIR}/core/controllets/controllet.hpp)
  if(NOT EXISTS ${CMAKE_BINARY_DIR}/pch.cpp)  # a newer one would trigger a full rebuild
    file(WRITE ${CMAKE_BINARY_DIR}/pch.cpp "")
  endif()
  function(multipanda_pch name)
    target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR})
    target_link_libraries(${name} PRIVATE multipanda_flags Eigen3::Eigen)
    if(MULTIPANDA_PCH_LIBRARIES)
      target_link_libraries(${name} PRIVATE fmt::fmt nlohmann_json::nlohmann_json)
    endif()
    target_precompile_headers(${name} PRIVATE ${MULTIPANDA_PCH_HEADERS} ${ARGN})
  endfunction()
  add_library(multipanda_pch STATIC ${CMAKE_BINARY_DIR}/pch.cpp)
  multipanda_pch(multipanda_pch)
  # Programs of commands (multipanda_program in cli): not optimized.
  add_library(multipanda_program_pch STATIC EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/pch.cpp)
  multipanda_pch(multipanda_program_pch <CLI/CLI.hpp>)
  target_link_libraries(multipanda_program_pch PRIVATE CLI11::CLI11 fmt::fmt)
  target_compile_options(multipanda_program_pch PRIVATE ${MULTIPANDA_PROGRAM_LEVEL})
  # An executable like the tests: precompiled headers of libraries (-fPIC) and programs (-fPIE) are incompatible.
  add_executable(multipanda_test_pch EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/pch.cpp)
  multipanda_pch(multipanda_test_pch <gtest/gtest.h>)
  target_link_libraries(multipanda_test_pch PRIVATE GTest::gtest_main)
  target_compile_options(multipanda_test_pch PRIVATE ${MULTIPANDA_OFF_LOOP})
  if(MULTIPANDA_SANITIZER)
    target_compile_options(multipanda_test_pch PRIVATE -O0)
  endif()
endif()

# Parsing headers takes most of a file's compile time, so a target's files are compiled in batches. The lint stage
# compiles each file by itself, because a batch can hide a missing include. Files in ARGN stay out of the batches.
option(MULTIPANDA_BATCHES "Compile the files of a target in batches (unity build)" ON)
function(multipanda_batch name)
  if(MULTIPANDA_BATCHES)
    set_target_properties(${name} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 20)
    if(ARGN)
      set_source_files_properties(${ARGN} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endif()
endfunction()

function(multipanda_library name)
  cmake_parse_arguments(ARG "SHARED;OFF_LOOP" "" "SOURCES;DEPS;PRIVATE_DEPS;HEAVY" ${ARGN})
  set(kind STATIC)
  if(ARG_SHARED)
    set(kind SHARED)
  endif()
  add_library(${name} ${kind} ${ARG_SOURCES} ${ARG_HEAVY})
  add_library(multipanda::${name} ALIAS ${name})
  # HEAVY: files that only wrap Pinocchio or Eigen's solvers. Undefined-behavior checks in their templates take minutes
  # and gigabytes per file.
  if(ARG_HEAVY AND MULTIPANDA_SANITIZER MATCHES "address|undefined")
    set_source_files_properties(${ARG_HEAVY} PROPERTIES COMPILE_OPTIONS -fno-sanitize=undefined)
  endif()
  # Pinocchio asserts that states are finite. Here NaN must pass through in every build, because the safety stage
  # detects it.
  if(ARG_HEAVY)
    set_source_files_properties(${ARG_HEAVY} PROPERTIES COMPILE_DEFINITIONS "$<$<NOT:$<CONFIG:Release>>:NDEBUG>")
  endif()
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${CMAKE_SOURCE_DIR}>)
  target_link_libraries(${name} PUBLIC ${ARG_DEPS} PRIVATE multipanda_flags ${ARG_PRIVATE_DEPS})
  if(ARG_OFF_LOOP)
    target_compile_options(${name} PRIVATE ${MULTIPANDA_OFF_LOOP})
  endif()
  multipanda_batch(${name} ${ARG_HEAVY})
  if(MULTIPANDA_PCH)
    target_precompile_headers(${name} REUSE_FROM multipanda_pch)
    set_target_properties(${name} PROPERTIES PCH_WARN_INVALID OFF)  # files with other flags parse them again
  endif()
endfunction()

# A library libmultipanda_FILE.so beside the core's, loaded with its first use (from_own_library in common).
function(multipanda_lazy_library name file)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  add_library(${name} MODULE ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} multipanda_flags)
  set_target_properties(${name} PROPERTIES OUTPUT_NAME multipanda_${file} LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/core
                        CXX_VISIBILITY_PRESET hidden INSTALL_RPATH "$ORIGIN")
endfunction()

# For programs that load the ROS module: the module looks symbols up in its own libraries first (runtime/ros_module.cpp),
# so the program must not contain copies of a shared library's variables (std::cout, locale ids).
function(multipanda_without_copies name)
  target_compile_options(${name} PRIVATE -fPIC)
  target_link_options(${name} PRIVATE -Wl,-z,nocopyreloc)
endfunction()

function(multipanda_test name)
  cmake_parse_arguments(ARG "FIRST" "SHARDS" "SOURCES;DEPS;LABELS;SERIES" ${ARGN})
  if(NOT ARG_SOURCES)
    message(FATAL_ERROR "multipanda_test(${name}) has no sources; an empty test would always pass")
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} multipanda_flags GTest::gtest GTest::gmock GTest::gtest_main)
  # Tests are compiled once and run once: -O1 halves their build time. The code under test keeps its own level.
  # Checks for undefined behavior take half the time to compile at -O0.
  target_compile_options(${name} PRIVATE ${MULTIPANDA_OFF_LOOP})
  if(MULTIPANDA_SANITIZER)
    target_compile_options(${name} PRIVATE -O0)
  endif()
  multipanda_batch(${name})
  if(MULTIPANDA_PCH)
    target_precompile_headers(${name} REUSE_FROM multipanda_test_pch)
  endif()
  target_compile_definitions(${name} PRIVATE MULTIPANDA_SOURCE_DIR="${CMAKE_SOURCE_DIR}"
                             MULTIPANDA_BINARY_DIR="${CMAKE_BINARY_DIR}")
  set(labels ${ARG_LABELS} gtest)
  if(ARG_FIRST)
    list(APPEND labels first)
    add_dependencies(first_tier ${name})
  endif()
  if(NOT ARG_SHARDS)
    set(ARG_SHARDS 1)
  endif()
  math(EXPR last "${ARG_SHARDS} - 1")
  foreach(shard RANGE ${last})
    set(test ${name})
    if(ARG_SHARDS GREATER 1)
      string(APPEND test _${shard})
    endif()
    add_test(NAME ${test} COMMAND ${name} --gtest_brief=1)
    set_tests_properties(${test} PROPERTIES TIMEOUT 1200 LABELS "${labels}"
                         ENVIRONMENT "GTEST_TOTAL_SHARDS=${ARG_SHARDS};GTEST_SHARD_INDEX=${shard}")
  endforeach()
  if(ARG_SERIES)
    add_test(NAME series_${name} CONFIGURATIONS full
             COMMAND ${MULTIPANDA_VENV}/bin/python -B ${CMAKE_SOURCE_DIR}/tests/series.py $<TARGET_FILE:multipanda> $<TARGET_FILE:${name}> ${ARG_SERIES})
    set_tests_properties(series_${name} PROPERTIES LABELS series TIMEOUT 36000 RUN_SERIAL ON COST 900)
  endif()
endfunction()
