#!/bin/sh
# Debian's ROS 1 (rospy, actionlib, roslaunch) in a virtual environment of its own.
#   tools/ros1_venv.sh VENV
# No root: packages that are not installed are fetched by apt-get, which checks their signatures, and
# unpacked into VENV/debian. Nothing outside VENV changes. Exit code 3 and a reason where this
# system does not have them. Does nothing where it has been done.
set -eu
[ $# -eq 1 ] || { sed -n '2,6s/^# \{0,1\}//p' "$0"; exit 2; }
venv=$1 python=/usr/bin/python3
packages="python3-rospy python3-actionlib python3-roslaunch python3-rostopic python3-rosparam rosout
 python3-sensor-msgs python3-trajectory-msgs python3-diagnostic-msgs python3-std-srvs python3-defusedxml"
refuse() { printf '%s: %s\n' "$0" "$1" >&2; exit 3; }
now=$({ printf '%s' "$packages"; cat "$0"; "$python" --version; } | cksum)
stamp=$venv/.sjerk-ros1
[ "$(cat "$stamp" 2>/dev/null || true)" != "$now" ] || exit 0

for tool in apt-get dpkg-deb "$python"; do
    command -v "$tool" >/dev/null 2>&1 || refuse "no $tool: ROS 1 comes from Debian's packages"
done
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    refuse "Debian's Python is older than 3.11, which sjerk needs"
"$python" -c 'import ensurepip, venv' 2>/dev/null || refuse "no venv module (apt install python3-venv)"
header=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include") + "/Python.h")')
[ -e "$header" ] || refuse "no Python headers (apt install python3-dev)"

rm -rf "$venv"
"$python" -m venv --system-site-packages "$venv"
venv=$(readlink -f "$venv")
root=$venv/debian work=$venv/apt
mkdir -p "$root" "$work/lists/partial" "$work/cache/archives/partial"
# What is missing here and has to be fetched; by the lists of the system, else by fresh ones of our own.
own=""
# shellcheck disable=SC2086
missing() { apt-get $own -o Debug::NoLocking=1 -qq --no-install-recommends --simulate install $packages 2>"$work/log"; }
fetch() {
    missing >"$work/told" || return 1
    sed -n 's/^Inst \([^ ]*\) .*/\1/p' "$work/told" >"$work/names"
    [ -s "$work/names" ] || return 0
    # shellcheck disable=SC2086,SC2046
    (cd "$work/cache/archives" && apt-get $own -o Debug::NoLocking=1 -qq download $(cat "$work/names") 2>"$work/log")
}
fetch || {
    own="-o Dir::State::lists=$work/lists -o Dir::Cache=$work/cache -o APT::Sandbox::User="
    # shellcheck disable=SC2086
    apt-get $own -o Debug::NoLocking=1 -qq update 2>"$work/log" && fetch || {
        tail -3 "$work/log" >&2
        refuse "apt-get cannot fetch $(printf '%s' "$packages" | tr -s ' \n' ' ')"
    }
}
for file in "$work"/cache/archives/*.deb; do
    [ ! -e "$file" ] || dpkg-deb -x "$file" "$root"
done
rm -rf "$work"
printf '%s\n' "$root/usr/lib/python3/dist-packages" \
    >"$("$venv/bin/python" -c 'import site; print(site.getsitepackages()[0])')/ros1.pth"
# The programs, run by this environment's Python.
for file in "$root"/usr/bin/ros*; do
    [ -e "$file" ] || continue
    mine=$venv/bin/$(basename "$file")
    { printf '#!%s\n' "$venv/bin/python"; tail -n +2 "$file"; } >"$mine"
    chmod +x "$mine"
done
# roslaunch finds the programs of a package beside its package.xml, without catkin.
for file in "$root"/usr/lib/ros*/ros*; do
    [ ! -f "$file" ] || ln -sf "$file" "$root/usr/share/$(basename "$(dirname "$file")")/"
done
cat >"$venv/ros1.sh" <<END
# Sourced: where ROS 1 is.
export PATH="$venv/bin:\$PATH" ROS_ETC_DIR="$root/etc/ros"
export ROS_PACKAGE_PATH="$root/usr/share\${ROS_PACKAGE_PATH:+:\$ROS_PACKAGE_PATH}"
export LD_LIBRARY_PATH="$(echo "$root"/usr/lib/*-linux-gnu*)\${LD_LIBRARY_PATH:+:\$LD_LIBRARY_PATH}"
END
[ -e "$root/etc/ros" ] || sed -i '/ROS_ETC_DIR/s/ ROS_ETC_DIR.*//; /ROS_PACKAGE_PATH=/d; /LD_LIBRARY_PATH/d' "$venv/ros1.sh"
"$venv/bin/python" -c 'import actionlib, diagnostic_msgs.msg, genpy.dynamic, roslaunch, rospy, sensor_msgs.msg' ||
    refuse "what was unpacked cannot be imported; the lines above say why"
printf '%s' "$now" >"$stamp"
