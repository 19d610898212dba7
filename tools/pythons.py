"""Tries every supported Python that is installed: the wheel, the README's first lines, some tests.

    python tools/pythons.py [ARGUMENTS OF PYTEST]

One wheel is built and serves all. A Python that is not there is named and left out; the exit code
is 1 where one fails, and where none is there.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SUPPORTED = ("3.11", "3.12", "3.13", "3.14")
TESTS = ("tests/base", "tests/planner", "tests/cycle", "tests/house/test_public_api.py")
NEEDED = ("pytest", "hypothesis", "ruckig", "rosbags", "pyarrow", "mcap")


def candidates(version: str) -> list[str]:
    """Where a Python of this version may be: the path, and what pyenv has."""
    found = [shutil.which(f"python{version}")]
    found += map(str, sorted(Path.home().glob(f".pyenv/versions/{version}*/bin/python")))
    found += map(str, sorted(Path("/opt").glob(f"python*{version}*/bin/python{version}")))
    return [path for path in found if path]


def working(version: str) -> str | None:
    """The first of them that runs and is of this version."""
    ask = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    for path in candidates(version):
        run = subprocess.run([path, "-c", ask], capture_output=True, text=True, check=False)
        if run.stdout.strip() == version:
            return path
    return None


def quiet(*words: str | Path, cwd: Path = ROOT) -> None:
    """Run; show its output only where it fails."""
    done = subprocess.run(
        list(map(str, words)), capture_output=True, text=True, cwd=cwd, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, words))}\n{done.stdout}{done.stderr}")


def tried(python: str, wheel: Path, folder: Path, words: list[str]) -> str:
    """Install, run; the last line of pytest."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    own = folder / "bin" / "python"
    quiet(own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
    block = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[0]
    script = folder / "first.py"
    script.write_text(block)
    quiet(own, script, cwd=folder)
    quiet(own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *NEEDED)
    tests = subprocess.run(
        [own, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(words or TESTS)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    if tests.returncode:
        raise RuntimeError("\n".join((tests.stdout + tests.stderr).splitlines()[-40:]))
    return tests.stdout.strip().splitlines()[-1]


def main() -> int:
    """1 where one fails, or none is there."""
    print(f"building with {sys.version.split()[0]}", flush=True)
    wrong = ran = 0
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "builder"
        venv.create(built, with_pip=True)
        python = built / "bin" / "python"
        quiet(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "build")
        own = f"-Cbuild-dir={folder}/build"  # not that of an editable installation
        quiet(python, "-m", "build", "--wheel", own, "--outdir", folder, ROOT)
        (wheel,) = Path(folder).glob("*.whl")
        for version in SUPPORTED:
            found = working(version)
            if found is None:
                print(f"{version}: SKIPPED: not installed", flush=True)
                continue
            ran += 1
            try:
                print(
                    f"{version}: {tried(found, wheel, Path(folder) / version, sys.argv[1:])}",
                    flush=True,
                )
            except (RuntimeError, subprocess.CalledProcessError) as fault:
                wrong += 1
                print(f"{version}: FAILED: {fault}", flush=True)
    return 1 if wrong or not ran else 0


if __name__ == "__main__":
    raise SystemExit(main())
