# Build type, language, warnings and sanitizers: the same for every target of ours.
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
endif()
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

# Vector flags change Eigen's alignment. Pinocchio's prebuilt library was built without them, so objects passed to it
# would crash at random.
if("${CMAKE_CXX_FLAGS} $ENV{CXXFLAGS}" MATCHES "-march=|-mavx|-mtune=native|-mfma")
  message(FATAL_ERROR "CMAKE_CXX_FLAGS or CXXFLAGS contains a vector flag (-march, -mavx, -mfma). Eigen objects would "
                      "no longer match the prebuilt Pinocchio; remove the flag.")
endif()

set(MULTIPANDA_SANITIZER "" CACHE STRING "address (with undefined), undefined or thread; empty for none")
set_property(CACHE MULTIPANDA_SANITIZER PROPERTY STRINGS "" address undefined thread)
option(MULTIPANDA_SIMULATOR "Simulators and all that needs them; OFF: a program for arms alone (docs/install.md)" ON)
option(MULTIPANDA_WERROR "Treat warnings of this project's targets as errors" ON)

option(MULTIPANDA_PCH "Precompile the headers that nearly every file includes (cmake/targets.cmake)" OFF)
find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE_PROGRAM})
  if(MULTIPANDA_PCH)  # ccache caches files with precompiled headers only with these settings
    set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env
        CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime ${CCACHE_PROGRAM})
    add_compile_options($<$<COMPILE_LANG_AND_ID:CXX,GNU>:-fpch-preprocess>
                        "$<$<COMPILE_LANG_AND_ID:CXX,Clang>:SHELL:-Xclang -fno-pch-timestamp>")
  endif()
endif()

# GCC spends a tenth of its time on garbage collection unless its heap may first grow to this size in KiB.
add_compile_options($<$<COMPILE_LANG_AND_ID:CXX,GNU>:--param=ggc-min-heapsize=524288>)

# A file with Pinocchio's headers takes up to 4 GB: compile at most two at a time.
set_property(GLOBAL PROPERTY JOB_POOLS heavy=2)

add_library(multipanda_flags INTERFACE)
target_compile_options(multipanda_flags INTERFACE -Wall -Wextra -Wconversion -Wshadow -Wno-psabi
                       -Wno-missing-field-initializers  # designated initializers omit defaults on purpose
                       -Wno-sign-conversion  # part of Clang's -Wconversion, not of GCC's
                       -fno-semantic-interposition -fvisibility-inlines-hidden)
if(MULTIPANDA_WERROR)
  target_compile_options(multipanda_flags INTERFACE -Werror)
endif()
# Resolve every symbol at load time, so that the first call of a function in the loop does not enter the linker.
target_link_options(multipanda_flags INTERFACE -Wl,-z,now -Wl,--as-needed)

if(MULTIPANDA_SANITIZER STREQUAL "address")
  # The prebuilt libraries were compiled without __SANITIZE_ADDRESS__, with which Eigen selects another allocator.
  # One build checks addresses and undefined behavior, so each file is parsed once for both. What of the second is
  # also found by the first (null, a place behind an object) or harmless on x86-64 would double the compile time.
  target_compile_options(multipanda_flags INTERFACE -fsanitize=address,undefined -fno-sanitize-recover=undefined
                         -fno-sanitize=null,alignment,object-size -fno-omit-frame-pointer -O1 -g1)
  target_compile_definitions(multipanda_flags INTERFACE EIGEN_MALLOC_ALREADY_ALIGNED=1)
  target_link_options(multipanda_flags INTERFACE -fsanitize=address,undefined)
elseif(MULTIPANDA_SANITIZER STREQUAL "undefined")
  target_compile_options(multipanda_flags INTERFACE -fsanitize=undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer -O1 -g1)
  target_link_options(multipanda_flags INTERFACE -fsanitize=undefined)
elseif(MULTIPANDA_SANITIZER STREQUAL "thread")
  target_compile_options(multipanda_flags INTERFACE -fsanitize=thread -O1 -g1 -Wno-tsan)
  target_link_options(multipanda_flags INTERFACE -fsanitize=thread)
elseif(MULTIPANDA_SANITIZER)
  message(FATAL_ERROR "MULTIPANDA_SANITIZER is '${MULTIPANDA_SANITIZER}'; expected address, undefined or thread")
endif()
