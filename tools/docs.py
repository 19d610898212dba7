"""The documentation site: pages as they stand, the reference from the code, the examples' pictures.

    python tools/docs.py FOLDER [--no-gallery]      writes FOLDER/html; a warning is an error

Nothing is fetched. Relative links and their anchors are checked by Sphinx; a link to a file outside
``docs`` must lead to one.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import sjerk
from sjerk.__main__ import arguments
from sjerk.cli.parser import Parser
from sjerk.drive import objects
from sjerk.kernel import FeedForward

ROOT = Path(__file__).resolve().parent.parent
#: Rooms whose exported names have a page, by what a reader wants to do.
ROOMS = {
    "sjerk": "Plan, run and command: the names that most programs need",
    "sjerk.planner": "Plan, also in a loop of your own",
    "sjerk.kernel": "Describe axes and run a kernel",
    "sjerk.host": "Command a kernel, read what it does",
    "sjerk.executor": "Serve goals of an action server",
    "sjerk.recording": "Record, simulate, replay",
    "sjerk.cia402": "A CiA 402 drive",
    "sjerk.ports.ethercat": "EtherCAT: main device and emulated line",
}


# ---- pages as they stand


def lay_out(source: Path) -> None:
    """Copy the pages; links that leave ``docs`` become the text of the link."""
    shutil.copytree(ROOT / "docs", source, dirs_exist_ok=True)
    for page in source.rglob("*.md"):
        here = ROOT / "docs" / page.relative_to(source).parent

        def inside(link: re.Match[str], here: Path = here, page: Path = page) -> str:
            target = (here / link[2].partition("#")[0]).resolve()
            if re.match(r"[a-z]+:", link[2]) or target.is_relative_to(ROOT / "docs"):
                return link[0]
            if not target.exists():
                raise SystemExit(f"{page}: no file {link[2]}")
            return link[1]

        text = page.read_text()
        page.write_text(re.sub(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)", inside, text))


# ---- the reference


def python_reference(folder: Path) -> None:
    """A page per room, and its names from their docstrings."""
    pages = []
    for room, task in ROOMS.items():
        module = sys.modules.get(room) or __import__(room, fromlist=["*"])
        names = [n for n in module.__all__ if room == "sjerk" or n not in sjerk.__all__]
        lines = [f"{room}", "=" * len(room), "", f"{task}.", ""]
        for name in names:
            lines += directive(room, name, getattr(module, name))
        file = folder / f"{room}.rst"
        file.write_text("\n".join(lines))
        pages.append((room, task))
    rows = "\n".join(f"| [{room}]({room}.rst) | {task} |" for room, task in pages)
    toc = "\n".join(room for room, _ in pages)
    (folder / "python.md").write_text(
        f"# Python\n\nWhat do you want to do?\n\n| room | task |\n|---|---|\n{rows}\n\n"
        f"```{{toctree}}\n:hidden:\n{toc}\n```\n"
    )


def directive(room: str, name: str, thing: Any) -> list[str]:
    """How Sphinx is asked for it."""
    full = f"{room}.{name}"
    if inspect.isclass(thing):
        hidden = "\n   :exclude-members: memory" if dataclasses.is_dataclass(thing) else ""
        return [f".. autoclass:: {full}", f"   :members:{hidden}", ""]
    if callable(thing):
        return [f".. autofunction:: {full}", ""]
    return [f".. py:data:: {full}", "", "   A constant.", ""]


def command_line(file: Path) -> None:
    """Every verb as its ``--help`` tells it."""

    def verbs(path: str, parser: Parser) -> Iterator[str]:
        level = "#" * (1 + len(path.split()))
        parser.prog = path
        help_text = parser.format_help().rstrip()
        yield f"{level} {path}\n\n```text\n{help_text}\n```\n"
        for verb, below in parser.verbs.items():
            yield from verbs(f"{path} {verb}", below)

    begin = (
        "# Command line\n\nWhat do you want to do? `sjerk VERB --help` tells the options of a verb."
    )
    file.write_text(f"{begin}\n\n" + "\n".join(verbs("sjerk", arguments())))


def toml(file: Path) -> None:
    """The tables of a file, from the classes that read them."""
    lines = [
        "# The TOML file of a kernel",
        "",
        "You describe axes, limits, drives, clock and reactions. `sjerk new robot.toml` writes",
        "such a file; `examples/robot.toml` is one of two axes:",
        "",
        "```toml",
        (ROOT / "examples" / "robot.toml").read_text().rstrip(),
        "```",
        "",
        "Top level: `name`, `cycle_time` (s), and the tables below. `[ethercat]` and",
        "`[axes.ethercat]` are told in [EtherCAT](../explanation/ethercat.md), `[panel]` in",
        "[the panel](../panel.md).",
        "",
    ]
    tables = {
        "[[axes]]": sjerk.Axis,
        "limits, stop_limits": sjerk.Limits,
        "drive": sjerk.DriveConfig,
        "feed_forward": FeedForward,
        "[clock]": sjerk.Clock,
        "[reactions]": sjerk.Reactions,
    }
    for title, kind in tables.items():
        meaning = (inspect.getdoc(kind) or "").partition(">>>")[0].rstrip()
        named = objects_of_settings() if kind is sjerk.DriveConfig else {}
        more = (" object | unit |", "---|---|") if named else ("", "")
        lines += [f"## {title}", "", meaning, ""]
        lines += [f"| field | type | default |{more[0]}", f"|---|---|---|{more[1]}"]
        for field in dataclasses.fields(kind):
            if field.init:
                cells = [f"`{field.name}`", escaped(field.type), escaped(default(field))]
                cells += map(escaped, named.get(field.name, ("", ""))) if named else ()
                lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    file.write_text("\n".join(lines))


def objects_of_settings() -> dict[str, tuple[str, str]]:
    """Object and unit by the field of the drive's settings that it holds."""
    found = {}
    for index in sorted(objects.OBJECTS):
        for row in objects.OBJECTS[index].entries:
            room, _, field = row.source.partition(".")
            if room == "config":
                found.setdefault(field, (f"{index:04X}h:{row.sub} {row.name}", row.unit))
    return found


def default(field: Any) -> str:
    """As it would be written; a field without one is needed."""
    if field.default is not dataclasses.MISSING:
        value = field.default
        return f"`{value.name.lower() if isinstance(value, enum.Enum) else value!r}`"
    return "its own" if field.default_factory is not dataclasses.MISSING else "needed"


def escaped(text: object) -> str:
    """In a cell of a table."""
    return str(text).replace("|", "or").replace("*", "\\*")


def drive_objects(file: Path) -> None:
    """The dictionary of the simulated drive."""
    lines = [
        "# Objects of the drive",
        "",
        "You read or write an object over CANopen or EtherCAT. The simulated drive has these.",
        "",
        "| object | name | type | access | unit |",
        "|---|---|---|---|---|",
    ]
    for index in sorted(objects.OBJECTS):
        for row in objects.OBJECTS[index].entries:
            shown = (f"{index:04X}h:{row.sub}", row.name, row.type.name, row.access, row.unit)
            lines.append(f"| {' | '.join(map(escaped, shown))} |")
    file.write_text("\n".join(lines) + "\n")


# ---- the gallery


def gallery(source: Path) -> None:
    """Run each example; its text, its picture, its code."""
    pictures = source / "gallery"
    pictures.mkdir()
    page = [
        "# Gallery",
        "",
        "Each picture was drawn by the program below it when this site was built.",
        "",
    ]
    for example in sorted((ROOT / "examples").glob("*.py")):
        picture = pictures / f"{example.stem}.png"
        done = subprocess.run(
            [sys.executable, example, picture], capture_output=True, text=True, check=False
        )
        if done.returncode or not picture.exists():
            raise SystemExit(f"{example.name}: {done.stderr}")
        code = example.read_text()
        title = code.split('"""')[1].splitlines()[0].rstrip(".")
        page += [f"## {title}", "", f"![{title}](gallery/{picture.name})", ""]
        page += ["```text", done.stdout.rstrip(), "```", "", f"`examples/{example.name}`:", ""]
        page += ["```python", code.rstrip(), "```", ""]
    (source / "gallery.md").write_text("\n".join(page))


def main() -> int:
    """Lay out, generate, build; the exit code of Sphinx."""
    folder = Path(sys.argv[1])
    source = folder / "source"
    shutil.rmtree(folder, ignore_errors=True)
    lay_out(source)
    reference = source / "reference"
    reference.mkdir(exist_ok=True)
    python_reference(reference)
    command_line(reference / "command_line.md")
    toml(reference / "toml.md")
    drive_objects(reference / "objects.md")
    gallery(source)
    order = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    done = subprocess.run([*order, source, folder / "html"], check=False)
    if done.returncode == 0:
        print(f"docs: {folder / 'html' / 'index.html'}, 0 warnings")
    return done.returncode


if __name__ == "__main__":
    raise SystemExit(main())
