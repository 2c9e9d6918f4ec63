#!/bin/bash
# Builds the ros2_control packages of ros/ with colcon and runs their tests, on any ROS 2 with a controller_manager.
# Exits with 77 if there is none, or if everything passed but the descriptions could not be checked (ctest reports
# "skipped" and the reason).
#
#   ros/tests/run.sh BUILD_FOLDER
#
# Looks in this order: MULTIPANDA_ROS2_PREFIX (a folder with setup.bash), the sourced ROS 2 (AMENT_PREFIX_PATH),
# /opt/ros/*.
set -u
source_folder=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
build=${1:?usage: ros/tests/run.sh BUILD_FOLDER}
say() { printf 'ros2_control: %s\n' "$*"; }

has_manager() { [ -e "$1/share/controller_manager/package.xml" ]; }

source_setup() {
  set +u
  # shellcheck disable=SC1091
  . "$1/setup.bash"
  set -u
}

sourced() {
  local folder
  local IFS=:
  for folder in ${AMENT_PREFIX_PATH:-}; do
    if has_manager "$folder"; then found=$folder; return 0; fi
  done
  return 1
}

find_ros() {
  local folder
  if [ -n "${MULTIPANDA_ROS2_PREFIX:-}" ]; then
    if [ ! -e "$MULTIPANDA_ROS2_PREFIX/setup.bash" ]; then
      say "MULTIPANDA_ROS2_PREFIX=$MULTIPANDA_ROS2_PREFIX has no setup.bash: name the folder of a ROS 2, such as /opt/ros/jazzy."
      exit 1
    fi
    source_setup "$MULTIPANDA_ROS2_PREFIX"
    if ! sourced; then
      say "$MULTIPANDA_ROS2_PREFIX has no controller_manager: install ros2_control there, or name another folder."
      exit 1
    fi
    return 0
  fi
  sourced && return 0
  for folder in $(ls -d /opt/ros/*/ 2>/dev/null | sort -r); do
    folder=${folder%/}
    if has_manager "$folder" && [ -e "$folder/setup.bash" ]; then
      source_setup "$folder"
      found=$folder
      return 0
    fi
  done
  return 1
}

found=
if ! find_ros; then
  printf 'skipped: %s %s\n' "no ROS 2 with controller_manager found: the ros2_control packages were not built and not tested." \
    "Source one, or set MULTIPANDA_ROS2_PREFIX to its folder (such as /opt/ros/jazzy), and test again."
  exit 77
fi
if ! command -v colcon >/dev/null; then
  say "$found has a controller_manager, but there is no colcon: apt install python3-colcon-common-extensions."
  exit 1
fi
version=$(sed -n 's/.*<version>\(.*\)<\/version>.*/\1/p' "$found/share/controller_manager/package.xml" | head -1)
say "building on $found (controller_manager $version)"

# Keeps the traffic of these tests on this computer and apart from each other.
export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT FASTDDS_BUILTIN_TRANSPORTS=SHM
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$((101 + $$ % 100))}
export ROS_LOG_DIR=${ROS_LOG_DIR:-$build/log}
export MULTIPANDA_PROGRAM=${MULTIPANDA_PROGRAM:-$source_folder/build/multipanda}

# Not ros/ itself: colcon would take it for one package.
packages=("$source_folder"/ros/multipanda* "$source_folder/ros/tests")
mkdir -p "$build" || exit 1
build=$(cd "$build" && pwd)
cd "$build" || exit 1
colcon --log-base "$build/log" build --base-paths "${packages[@]}" --build-base "$build/build" --install-base \
  "$build/install" --merge-install --executor sequential --event-handlers console_direct- console_cohesion+ \
  --cmake-args -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=ON ${MULTIPANDA_ROS2_CMAKE_ARGS:-} || exit 1
# Tests that need the launch libraries of a ROS 2: they read every launch file.
set +u
# shellcheck disable=SC1091
. "$build/install/setup.bash"
set -u
python3 "$source_folder/tests/ros/description_test.py"
description=$?
colcon --log-base "$build/log" test --base-paths "${packages[@]}" --build-base "$build/build" --install-base \
  "$build/install" --merge-install --executor sequential --event-handlers console_direct- --return-code-on-test-failure \
  --ctest-args --output-on-failure
code=$?
colcon test-result --test-result-base "$build/build" --verbose
if [ $code -eq 0 ] && [ $description -eq 77 ]; then
  printf 'skipped: %s\n' "the robot descriptions and launch files were not checked, since the Python of $found has no xacro: apt install ros-*-xacro. Everything else was built and passed."
  exit 77
fi
if [ $code -eq 0 ]; then code=$description; fi
if [ $code -eq 0 ]; then say "built and tested on $found (controller_manager $version)"; fi
exit $code
