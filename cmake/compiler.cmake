# Before project(): Clang compiles these files in two thirds of GCC's time, with equally fast code and the same torques.
# CC and CXX, or -DCMAKE_CXX_COMPILER, select another one; the sanitizers' presets use GCC, so that both compile the
# core.
if(NOT DEFINED CMAKE_CXX_COMPILER AND NOT DEFINED ENV{CXX})
  find_program(MULTIPANDA_CLANG clang++)
  if(MULTIPANDA_CLANG)
    set(CMAKE_CXX_COMPILER ${MULTIPANDA_CLANG})
  endif()
endif()
