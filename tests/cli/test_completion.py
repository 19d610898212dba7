"""Completion: shells offer what the parser takes, and nothing else."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from sjerk.__main__ import arguments, main
from sjerk.cli.completion import Node, bash, fish, nodes, zsh
from sjerk.host import BUFFERS

NODES = {node.path: node for node in nodes("", arguments())}


def offered(shell: str, words: list[str], tmp_path: Path) -> list[str]:
    """What a real shell offers for the last of these words."""
    tool = shutil.which(shell)
    if tool is None:
        pytest.skip(f"no {shell} (on Debian: apt install {shell})")
    script = tmp_path / "_sjerk"
    script.write_text({"bash": bash, "zsh": zsh, "fish": fish}[shell](list(NODES.values())))
    if shell == "bash":
        order = [tool, "--norc", "-c", _BASH, "bash", str(script), *words]
    elif shell == "zsh":
        order = [tool, "-f", "-c", _ZSH, "zsh", str(script), *words]
    else:
        line = " ".join(words)
        order = [tool, "--no-config", "-c", f"source {script}; complete -C '{line}'"]
    done = subprocess.run(order, capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return sorted(line.split("\t")[0] for line in done.stdout.splitlines())


_BASH = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _sjerk
printf '%s\\n' "${COMPREPLY[@]}"
"""
# The functions of zsh's completion that the script calls, in place of the line editor's own.
_ZSH = """
compdef() { : }
_files() { print -- FILES }
compadd() { shift; print -l -- $@ }
_describe() { local word; for word in $shown; do print -- ${word%%:*}; done }
source "$1"; shift
words=("$@"); CURRENT=$#; _sjerk | grep -- "^${words[CURRENT]}"
"""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_offers_the_verbs_and_the_options_of_each(shell: str, tmp_path: Path) -> None:
    """Verbs, verbs of a verb, options, choices of a value: those of the parser."""
    assert set(offered(shell, ["sjerk", "mo"], tmp_path)) == {"move", "monitor"}
    assert offered(shell, ["sjerk", "ethercat", "s"], tmp_path) == ["scan"]
    options = {name for option in NODES["move"].options for name in option.names}
    long = {name for name in options if name.startswith("--")}
    assert set(offered(shell, ["sjerk", "move", "--"], tmp_path)) == long
    assert "--force" in offered(shell, ["sjerk", "record", "run.mcap", "--fo"], tmp_path)
    assert offered(shell, ["sjerk", "completion", "ba"], tmp_path) == ["bash"]
    assert offered(shell, ["sjerk", "move", "--synchronization", "ph"], tmp_path) == ["phase"]
    blends = offered(shell, ["sjerk", "move", "--buffer", "blend"], tmp_path)
    modes = [mode for mode in BUFFERS if mode.startswith("blend ")]  # one word to the shell
    told = [mode.replace(" ", "\\ ") if shell == "bash" else mode for mode in modes]
    assert blends == sorted(told)


def test_every_verb_and_option_of_the_parser_is_known() -> None:
    """Each is a node, and each option stands in each script."""
    parser = arguments()
    assert set(NODES[""].verbs) == set(parser.verbs)
    for verb, below in parser.verbs.items():
        for action in below.arguments:
            for name in action.option_strings if not below.verbs else ():
                assert any(name in option.names for option in NODES[verb].options)
    for script in (bash, zsh):
        text = script(list(NODES.values()))
        assert all(
            name in text for node in NODES.values() for o in node.options for name in o.names
        )


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_helps_with_any_sign_leave_the_script_whole(shell: str, tmp_path: Path) -> None:
    """Quotes, dollars, colons, percent signs and backslashes of a help are text to the shell."""
    tool = shutil.which(shell)
    if tool is None:
        pytest.skip(f"no {shell} (on Debian: apt install {shell})")
    node = Node("", {"go": """it's "$(touch struck)" `touch struck` : %% \\ done"""}, (), ())
    script = tmp_path / "script"
    script.write_text({"bash": bash, "zsh": zsh, "fish": fish}[shell]([node]))
    begin = "compdef() { : }; " if shell == "zsh" else ""
    run = [tool, "-c", f"{begin}source {script}"]
    done = subprocess.run(run, capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "struck").exists()


def test_the_verb_prints_the_script(capsys: pytest.CaptureFixture[str]) -> None:
    """``sjerk completion zsh`` prints what zsh reads."""
    assert main(["completion", "zsh"]) == 0
    assert capsys.readouterr().out == zsh(list(NODES.values()))
