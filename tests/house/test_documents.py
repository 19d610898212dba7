"""The documents tell of a house that is there: links, files, commands and names all exist."""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.root import ROOT
from sjerk.__main__ import arguments
from sjerk.cli.arguments import shielded

DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
SOURCES = ROOT / "src" / "sjerk"
#: Words that look like files of the house and are of the reader's own.
OF_THE_READER = {"path.csv", "run.parquet", "whole.parquet", "run.mcap", "robot.toml", "drives.xml"}


def slug(heading: str) -> str:
    """The anchor that GitHub makes of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def prose(document: Path) -> str:
    """A document without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", document.read_text(), flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_each_link_leads_to_a_file_and_to_a_heading_of_it(document: Path) -> None:
    """Every relative link and picture, every anchor."""
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(document)):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        file = document.parent / name if name else document
        assert file.exists(), link
        headings = re.findall(r"^#+ (.*)$", prose(file), re.MULTILINE) if anchor else []
        assert not anchor or anchor in map(slug, headings), link


def places(name: str, document: Path) -> Iterator[Path]:
    """Where a document may mean a file: in the project, the sources, its own room."""
    yield from (ROOT / name, SOURCES / name, document.parent / name)
    if "/" not in name:
        for folder in ("src", "tests", "tools"):
            yield from (ROOT / folder).rglob(name)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_each_file_that_is_named_is_there(document: Path) -> None:
    """Words in code quotes that end as files of the house do; ``*`` stands for some."""
    for word in re.findall(r"`([^`\s]+)`", prose(document)):
        if word in OF_THE_READER or not re.fullmatch(r"[\w./*-]+(\.(py|c|h|md|toml)|/)", word):
            continue
        if "*" in word:
            found = [*ROOT.glob(word), *SOURCES.glob(word)]
        else:
            found = [place for place in places(word, document) if place.exists()]
        assert found, word


def reached(name: str) -> bool:
    """Whether ``sjerk.a.b`` is a module, or a name in one, or a member or field of a class."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            fields = getattr(found, "__dataclass_fields__", {})
            if part not in fields and not hasattr(found, part):
                return False
            found = getattr(found, part, None)
        return True
    return False


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_each_name_from_sjerk_is_there(document: Path) -> None:
    """``sjerk.room.Name`` in code quotes; in the table of the changelog those on the right."""
    text = re.sub(r"^\|[^|]*\|", "|", prose(document), flags=re.MULTILINE)
    for name in re.findall(r"`(sjerk(?:\.\w+)+)[`(]", text):
        assert reached(name), name


def has(owner: type, member: str) -> bool:
    """A field, a member, or what ``__init__`` makes."""
    fields = getattr(owner, "__dataclass_fields__", {})
    made = re.search(rf"self\.{member}\b", inspect.getsource(owner)) is not None
    return member in fields or hasattr(owner, member) or made


def test_a_class_that_a_document_names_has_the_member_that_it_names() -> None:
    """``Class.member`` in code quotes, for every public class of the house."""
    classes = {}
    for file in SOURCES.rglob("*.py"):
        module = ".".join(("sjerk", *file.relative_to(SOURCES).with_suffix("").parts))
        if file.name.startswith("__") or "ports" in file.parts or "cli" in file.parts:
            continue
        try:
            found = importlib.import_module(module)
        except ModuleNotFoundError:
            continue  # of an extra
        classes |= {k: v for k, v in vars(found).items() if inspect.isclass(v)}
    seen = 0
    for document in DOCUMENTS:
        text = re.sub(r"^\|[^|]*\|", "|", prose(document), flags=re.MULTILINE)
        for owner, member in re.findall(r"`([A-Z]\w+)\.(\w+)[`(]", text):
            if owner not in classes:
                continue
            seen += 1
            assert has(classes[owner], member), f"{document.name}: {owner}.{member}"
    assert seen > 20


def command_lines() -> Iterator[tuple[str, str]]:
    """Every ``sjerk VERB ...`` of a block, with the document it stands in."""
    for document in DOCUMENTS:
        if document.name == "CHANGELOG.md":
            continue
        fenced = False
        for line in document.read_text().splitlines():
            fenced ^= line.startswith("```")
            if not fenced and not line.startswith("    "):
                continue
            for part in re.split(r"&&|;|&\s*$|&\s+#", line.split("  #")[0].split(" #")[0]):
                words = part.strip().removeprefix("python -m ").split(" > ")[0].rstrip("& ")
                if words.startswith("sjerk "):
                    yield document.name, words


def test_each_command_line_of_the_documents_is_understood(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """By the parser: verbs, options and their number. Nothing is run."""
    lines = list(command_lines())
    assert len(lines) > 15
    for document, line in lines:
        try:
            parsed = arguments().parse_args(shielded(shlex.split(line)[1:]))
        except SystemExit:
            pytest.fail(f"{document}: {line}: {capsys.readouterr().err}")
        assert isinstance(parsed, argparse.Namespace)


def test_each_job_of_run_is_told_where_it_is_done() -> None:
    """``./run JOB`` in the documents is a job; each job stands in the head of ``run``."""
    text = (ROOT / "run").read_text()
    jobs = {
        job.strip()
        for line in re.findall(r"^([a-z][a-z0-9 |-]*)\)$", text, re.MULTILINE)
        for job in line.split("|")
    }
    told = {
        job
        for jobs_of_line in re.findall(r"^#   \./run ([a-z0-9|-]+)", text, re.MULTILINE)
        for job in jobs_of_line.split("|")
    }
    assert told == jobs
    for document in DOCUMENTS:
        for job in re.findall(r"\./run ([a-z0-9-]+)", document.read_text()):
            assert job in jobs, f"{document.name}: ./run {job}"
