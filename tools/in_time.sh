#!/bin/sh
# Runs a long check only if it can end in time: tools/in_time.sh SECONDS command...
# SECONDS is what the check needs at least. MULTIPANDA_TEST_END is the time (Unix, s) at which the whole run of the tests
# must be over; `./multipanda test` sets it from MULTIPANDA_TEST_MINUTES. Without it the check just runs. A check that has
# not ended by then is stopped, and counts as skipped (77).
set -u
needed=$1
shift
[ -n "${MULTIPANDA_TEST_END:-}" ] || exec "$@"
left=$((MULTIPANDA_TEST_END - $(date +%s)))
if [ "$left" -lt "$needed" ]; then
  echo "skipped: $left s of the time for all tests are left, and this needs at least $needed s: $*"
  exit 77
fi
code=0
timeout --kill-after=20 "$left" "$@" || code=$?
case $code in
  124 | 137)
    echo "skipped: the time for all tests ended after $left s of: $*"
    exit 77
    ;;
esac
exit "$code"
