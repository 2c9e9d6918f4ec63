#!/bin/sh
# Builds and runs the tests of the core and of the cockpit under one sanitizer: tools/sanitize.sh asan|ubsan|tsan
# One at a time: address and undefined-behavior checks together make Pinocchio's files seven times as slow to compile.
set -eu
preset=$1
cd "$(dirname "$0")/.."
cmake --preset "$preset"
# modes_test takes every controllet with every feature through the loop; the tests of single laws come along in the
# full series, where they concern the sanitizer: races need threads, and laws have none. cockpit_server_test has the
# thread that serves pages, and cockpit_wire_test reads the bytes of strangers; the cockpit's desk and a whole run with
# pages come along in the full series, because they need the simulation.
targets="core_test modes_test cockpit_server_test"
[ "$preset" = tsan ] || targets="$targets cockpit_wire_test"
if [ -n "${MULTIPANDA_FULL:-}" ]; then
  targets="$targets cockpit_test"
  [ "$preset" = tsan ] || targets="$targets core_tests_all"
fi
# shellcheck disable=SC2086
cmake --build --preset "$preset" --target $targets
# A test program that was not built has no label, so it is not run. Scripts need the program.
# The first fault ends the run: a run that is stopped for lack of time must not hide it (in_time.sh).
# Long series stay short here: the sanitizers look for faults of the code, not of the mathematics.
exec env -u MULTIPANDA_FULL \
  ctest --stop-on-failure --test-dir "build-$preset" -L '^(core|cockpit)$' -LE '^(script|lint)$' -E '^cockpit_page' --no-tests=error --output-on-failure -j 2
