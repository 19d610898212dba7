#!/bin/sh
# A ROS 2 from PyPI in a virtual environment of its own, with the interfaces that PyPI lacks.
#   tools/ros2_venv.sh kilted|jazzy VENV [PYTHON] [PACKAGE...]
# No root, no ROS. Needs cc and c++ (interfaces become C and C++ libraries); cmake and ninja come
# from PyPI. Does nothing where it has been done; PACKAGEs are given to pip each time.
set -eu
[ $# -ge 2 ] || { sed -n '2,5s/^# \{0,1\}//p' "$0"; exit 2; }
distro=$1 venv=$2 python=${3:-python3}
shift 2
[ $# -eq 0 ] || shift
here=$(dirname "$(readlink -f "$0")")
ros2=$here/../ros2
case $distro in
kilted) more="ament-cmake-ros-core" index="int32 index" multi_index="int32 multi_dof_index" ;;
jazzy) more="ament-cmake-ros" index="" multi_index="" ;;
*)
    printf '%s: kilted or jazzy, not %s\n' "$0" "$distro" >&2
    exit 2
    ;;
esac
for tool in cc c++; do
    command -v "$tool" >/dev/null 2>&1 || {
        printf '%s: %s is needed (on Debian: apt install g++)\n' "$0" "$tool" >&2
        exit 1
    }
done
began=$(date +%s)
say() { printf '%4s s  %s\n' "$(($(date +%s) - began))" "$1" >&2; }

running="rclpy rmw-fastrtps-cpp common-interfaces lifecycle-msgs"
# What an ament package of interfaces is built with; no wheel names all of it.
building="rosidl-default-generators rosidl-core-generators ament-package
 ament-cmake ament-cmake-core ament-cmake-export-definitions ament-cmake-export-dependencies
 ament-cmake-export-include-directories ament-cmake-export-interfaces ament-cmake-export-libraries
 ament-cmake-export-link-flags ament-cmake-export-targets ament-cmake-gen-version-h
 ament-cmake-include-directories ament-cmake-libraries ament-cmake-python ament-cmake-pytest
 ament-cmake-target-dependencies ament-cmake-test ament-cmake-version ament-cmake-gmock
 ament-cmake-gtest $more"
# These two have no alias of a distribution in Kilted.
plain="ros-python-cmake-module ros-fastrtps-cmake-module"

[ -e "$venv/bin/python" ] || "$python" -m venv "$venv"
venv=$(readlink -f "$venv")
stamp=$venv/.sjerk-ros2
now=$({ printf '%s' "$distro $running $building $plain"; cd "$ros2" && find pip cobot_msgs sjerk_msgs -type f | sort | xargs cat; } | cksum)
if [ "$(cat "$stamp" 2>/dev/null || true)" != "$now" ]; then
    say "wheels of ROS 2 $distro"
    # shellcheck disable=SC2086
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check cmake ninja catkin_pkg $plain \
        $(for name in $running $building; do printf 'ros-%s-%s ' "$distro" "$name"; done)
    # The CMake files of the wheels name the Python that they were built with.
    include=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    numpy=$("$venv/bin/python" -c 'import numpy; print(numpy.get_include())')
    grep -rlZ --include='*.cmake' /opt/python "$venv/share" | xargs -0 -r sed -i -E \
        -e "s#/opt/python/cp[0-9]+-cp[0-9]+/lib/python[0-9.]+/site-packages/numpy/_?core/include#$numpy#g" \
        -e "s#/opt/python/cp[0-9]+-cp[0-9]+/include/python[0-9.]+#$include#g"
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    cp -r "$ros2/pip/control_msgs" "$ros2/cobot_msgs" "$ros2/sjerk_msgs" "$work"
    action=$work/control_msgs/action/FollowJointTrajectory.action
    sed -e "s/%INDEX%/$index/" -e "s/%MDINDEX%/$multi_index/" "$action.in" >"$action"
    for package in control_msgs cobot_msgs sjerk_msgs; do
        say "$package"
        export AMENT_PREFIX_PATH="$venv"
        {
            PATH="$venv/bin:$PATH" cmake -G Ninja -S "$work/$package" -B "$work/build/$package" \
                -DCMAKE_INSTALL_PREFIX="$venv" -DCMAKE_PREFIX_PATH="$venv" \
                -DPython3_EXECUTABLE="$venv/bin/python" -DPython3_FIND_VIRTUALENV=ONLY \
                -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release -Wno-dev &&
                PATH="$venv/bin:$PATH" cmake --build "$work/build/$package" --target install
        } >"$work/log" 2>&1 || {
            tail -40 "$work/log" >&2
            exit 1
        }
    done
    printf '%s' "$now" >"$stamp"
    say "ready"
fi
[ $# -eq 0 ] || "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
