"""The package: wheel and sdist build, and the wheel imports in an empty environment."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import sjerk
from helpers.root import ROOT


def test_wheel_and_sdist_build_and_the_wheel_works_alone(tmp_path: Path) -> None:
    """Sdist -> wheel -> empty venv -> import, a profile, the recording; no extras needed."""
    subprocess.run(
        [sys.executable, "-m", "build", "--outdir", str(tmp_path), str(ROOT)],
        check=True,
        capture_output=True,
    )
    (sdist,) = tmp_path.glob("*.tar.gz")
    (wheel,) = tmp_path.glob("*.whl")
    assert "cp311-abi3" in wheel.name
    with tarfile.open(sdist) as archive:
        names = {Path(name).name for name in archive.getnames()}
    assert {"_kernel.c", "_kernel.h", "pyproject.toml", "LICENSE", "panda.mcap"} <= names
    with zipfile.ZipFile(wheel) as archive:
        names = {Path(name).name for name in archive.namelist()}
    assert {"py.typed", "panda.mcap", "panda_joint1.csv", "LICENSE"} <= names
    assert not [name for name in names if name.endswith((".c", ".h"))]
    venv.create(tmp_path / "empty", with_pip=True)
    python = tmp_path / "empty" / "bin" / "python"
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", str(wheel)], check=True, capture_output=True
    )
    program = (
        "import sjerk, sys; p = sjerk.scurve(160.0, sjerk.Limits(90.0, 500.0, 5000.0), 1e-3); "
        "assert p.sample().position[-1] == 160.0; "
        "from sjerk.trajectory.files import shipped_recording as s; assert s().exists(); "
        "assert 'matplotlib' not in sys.modules and 'rosbags' not in sys.modules; print('works')"
    )
    run = subprocess.run([python, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert run.stdout == "works\n", run.stderr
    # without the extra the demo prints the table and says what draws the picture
    run = subprocess.run(
        [python.with_name("sjerk"), "demo"], capture_output=True, text=True, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert "final error" in run.stdout
    assert "matplotlib draws it" in run.stdout


def test_everything_public_is_exported_and_documented() -> None:
    """Each name of ``sjerk.__all__`` exists and has a docstring."""
    for name in sjerk.__all__:
        assert getattr(sjerk, name).__doc__
