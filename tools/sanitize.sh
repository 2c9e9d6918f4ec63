#!/bin/sh
# Builds and runs the core's tests under one sanitizer: tools/sanitize.sh asan|ubsan|tsan
# One at a time: address and undefined-behaviour checks together make Pinocchio's files seven times as slow to compile.
set -eu
preset=$1
cd "$(dirname "$0")/.."
cmake --preset "$preset"
# Races need threads: the laws' own tests have one each, and would take half of this build. The guard's tests take
# every controllet with every feature through the loop; the laws' own tests come along in the full series.
case $preset in
  tsan) cmake --build --preset "$preset" --target core_test modes_test ;;
  *) if [ -z "${MULTIPANDA_FULL:-}" ]; then
       cmake --build --preset "$preset" --target core_test modes_test guard_test
     else
       cmake --build --preset "$preset" --target core_tests_all
     fi ;;
esac
# A test program that was not built has no label, so it is not run.
# Long series stay short here: the sanitizers look for faults of the code, not of the mathematics.
exec env -u MULTIPANDA_FULL \
  ctest --test-dir "build-$preset" -L core --no-tests=error --output-on-failure -j 2
