#!/bin/sh
# Builds and runs the core's tests under one sanitizer: tools/sanitize.sh asan|ubsan|tsan
# One at a time: address and undefined-behaviour checks together make Pinocchio's files seven times as slow to compile.
set -eu
preset=$1
cd "$(dirname "$0")/.."
cmake --preset "$preset"
cmake --build --preset "$preset" --target core_tests_all
# Long series stay short here: the sanitizers look for faults of the code, not of the mathematics.
exec env -u MULTIPANDA_FULL \
  ctest --test-dir "build-$preset" -L core --no-tests=error --output-on-failure -j 2
