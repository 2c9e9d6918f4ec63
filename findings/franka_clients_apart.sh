#!/bin/bash
# Guess: two Python clients of Franka's arms can be used in one program, Franka's own for one arm and franky for another.
# So it is: both register libfranka's types under the same names, and the second import fails, whichever comes first. Each
# alone works. A program with both needs two processes.
# Seen with pylibfranka 0.21.3 and franky-control 2.0.0 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pylibfranka==0.21.3 franky-control==2.0.0 numpy==2.4.6
for names in pylibfranka franky "pylibfranka, franky" "franky, pylibfranka"; do
    said=$("$folder/bin/python" -c "import $names" 2>&1 | tail -n 1) || true
    echo "import $names: ${said:-works}"
    case $names in
        *,*) [[ $said == *"already registered"* ]] || { echo "this has changed" && exit 1; } ;;
        *) [[ -z $said ]] ;;
    esac
done
