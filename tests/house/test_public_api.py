"""The public names from outside: one program uses all of them, and runs."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib import metadata

import sjerk
from helpers.root import ROOT

PROGRAM = ROOT / "tests" / "house" / "public_api.py"


def test_every_public_name_is_used_by_a_program_that_runs() -> None:
    """Imported from the top and used behind that; no other name is."""
    tree = ast.parse(PROGRAM.read_text())
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "sjerk"
        for alias in node.names
    }
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert imported == set(sjerk.__all__)
    assert imported <= used
    done = subprocess.run([sys.executable, str(PROGRAM)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{len(sjerk.__all__)} names\n"


def test_the_version_is_one() -> None:
    """In the project, its installation, the changelog and the citation."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert metadata.version("sjerk") == version
    heads = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert heads[:2] == ["Unreleased", version]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
