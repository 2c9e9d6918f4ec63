#!/bin/sh
# Builds and runs the tests of the core and of the cockpit under one sanitizer: tools/sanitize.sh asan|ubsan|tsan
# Its compilers use the cores only while nobody else does; its programs, which have clients that wait, are merely nice.
set -eu
preset=$1
cd "$(dirname "$0")/.."
cmake --preset "$preset"
# Races need threads, which these have: threads_test those that post to the loop, cockpit_server_test the one that hears
# the page server. modes_test takes every controllet with every feature through the loop; the tests of single laws come
# along in the full series, as do the cockpit's clients and a whole run with pages, because they need the simulation.
targets="threads_test cockpit_server_test"
[ "$preset" = tsan ] || targets="$targets core_test modes_test"
if [ -n "${MULTIPANDA_FULL:-}" ]; then
  targets="$targets cockpit_test"
  [ "$preset" = tsan ] || targets="$targets dynamics_test geometry_test guard_test controllets_test force_controllets_test coupled_ufic_test"
fi
# shellcheck disable=SC2086
chrt --idle 0 cmake --build --preset "$preset" --target $targets
# Only what was built is run. The first fault ends the run, so that nothing that follows hides it. Long series stay
# short, and those of a thousand random motions are left out: the sanitizers look for faults of the code, not of the
# mathematics.
exec nice env -u MULTIPANDA_FULL GTEST_FILTER='-*ViaMotion.KeepsItsLimits*:*SamplesAtRandom*' \
  ctest --stop-on-failure --test-dir "build-$preset" -R "^($(echo "$targets" | tr ' ' '|'))\$" --no-tests=error --output-on-failure -j 2
