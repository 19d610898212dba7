#!/bin/sh
# Builds the C for aarch64 with Debian's cross compiler and runs the golden programs under qemu-user.
#   tools/arm.sh FOLDER PYTHON [COMMAND...]   without root; COMMAND runs in place of the golden programs
# SJERK_WHEEL names a wheel for aarch64 that is taken in place of a build.
# FOLDER keeps the tools between runs. What it needs and cannot have is told in a line: SKIPPED.
set -eu
here=$(dirname "$(dirname "$(readlink -f "$0")")")
folder=$1
python=$2
shift 2

skip() { printf 'arm: SKIPPED: %s\n' "$1"; exit 0; }
for tool in apt-get dpkg-deb; do
    command -v "$tool" >/dev/null 2>&1 || skip "no $tool: this needs Debian or its like"
done
[ "$(uname -m)" = x86_64 ] || skip "this is no x86_64: run ./run test tests/house/test_golden.py instead"
mkdir -p "$folder"
folder=$(readlink -f "$folder")

# fetch NAME PACKAGES OPTIONS...: packages of apt and what they need, unpacked in a folder of our own
fetch() {
    name=$1 packages=$2
    shift 2
    [ -e "$folder/$name/.complete" ] && return
    printf 'arm: fetching %s\n' "$packages" >&2
    rm -rf "${folder:?}/$name"
    mkdir -p "$folder/$name/lists/partial" "$folder/$name/archives/partial" "$folder/$name/root"
    set -- -qq -o Dir::State::lists="$folder/$name/lists" -o Dir::Cache::archives="$folder/$name/archives" \
        -o Dir::Cache::pkgcache= -o Dir::Cache::srcpkgcache= -o Debug::NoLocking=1 "$@"
    apt-get "$@" update >&2 || skip "apt has no lists of packages"
    # shellcheck disable=SC2086 # words of a list
    apt-get "$@" -y --no-install-recommends --download-only install $packages >&2 ||
        skip "apt cannot have $packages"
    for package in "$folder/$name"/archives/*.deb; do
        dpkg-deb -x "$package" "$folder/$name/root"
    done
    rm -rf "$folder/$name/archives" "$folder/$name/lists"
    : >"$folder/$name/.complete"
}

# Both with an empty list of what is installed: the folders then have all that they need.
mkdir -p "$folder"
: >"$folder/nothing"
fetch tools "gcc-aarch64-linux-gnu qemu-user" -o Dir::State::status="$folder/nothing"
fetch target "python3-minimal libpython3-stdlib libpython3-dev libstdc++6" -o Dir::State::status="$folder/nothing" \
    -o APT::Architecture=arm64 -o APT::Architectures=arm64
tools=$folder/tools/root
target=$folder/target/root
arm_python=$(find "$target/usr/bin" -name 'python3.*[0-9]' | head -n 1)
version=$(basename "$arm_python" | sed 's/python//')

if [ ! -e "$folder/site-$version/.complete" ]; then
    printf 'arm: fetching numpy and cffi for aarch64, Python %s\n' "$version" >&2
    "$python" -m pip install --quiet --disable-pip-version-check --target "$folder/site-$version" \
        --only-binary=:all: --implementation cp --python-version "$version" \
        --platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 \
        --platform manylinux_2_27_aarch64 --platform manylinux_2_28_aarch64 numpy cffi ||
        skip "no numpy and cffi for aarch64 from the package index"
    : >"$folder/site-$version/.complete"
fi

# the package: the wheel, or the extension by the flags of CMakeLists.txt
build=$folder/build
rm -rf "$build"
mkdir -p "$build"
LD_LIBRARY_PATH=$tools/usr/lib/x86_64-linux-gnu PATH=$tools/usr/bin:$PATH
export PATH LD_LIBRARY_PATH
if [ -n "${SJERK_WHEEL:-}" ]; then
    "$python" -m zipfile -e "$SJERK_WHEEL" "$build"
else
    tar -c -C "$here/src" --exclude='*.c' --exclude='*.h' --exclude='*.so' --exclude=__pycache__ sjerk | tar -x -C "$build"
    "$python" "$here/tools/contract.py" "$build/_core.cdef" "$build/_core.c.in"
    "$python" -m cffi.gen_src read-sources sjerk._core "$build/_core.cdef" "$build/_core.c.in" "$build/_core.c" >/dev/null
    printf 'arm: %s\n' "$(aarch64-linux-gnu-gcc --version | head -n 1)"
    # shellcheck disable=SC2046 # names without spaces
    aarch64-linux-gnu-gcc --sysroot="$target" -B"$target/usr/lib/aarch64-linux-gnu" \
        -isystem "$target/usr/include/aarch64-linux-gnu" -isystem "$target/usr/include" -std=c11 -O3 -ffp-contract=off -fno-trapping-math -fno-math-errno \
        -flto=auto -fPIC -shared -fvisibility=hidden -DNDEBUG -DPy_LIMITED_API=0x030b0000 -I"$here/src/sjerk" \
        -I"$target/usr/include/python$version" "$build/_core.c" \
        $(find "$here/src/sjerk" -name '_*.c') -lm -o "$build/sjerk/_core.abi3.so"
fi
[ $# -gt 0 ] || set -- "$here/tools/golden.py"
export PYTHONPATH="$build:$folder/site-$version" PYTHONDONTWRITEBYTECODE=1
exec qemu-aarch64 -U LD_LIBRARY_PATH -L "$target" "$arm_python" "$@"
