"""``sjerk completion``: completion of verbs, options, choices and files in bash, zsh and fish.

The script is made of the parser itself, so that it knows what the command line knows. Never here:
what a verb does.
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sjerk.cli.parser import Parser

_HOW = """\
bash: sjerk completion bash > ~/.local/share/bash-completion/completions/sjerk
zsh:  sjerk completion zsh > DIR/_sjerk, with a folder DIR of $fpath before compinit
fish: sjerk completion fish > ~/.config/fish/completions/sjerk.fish"""


def add_arguments(jobs: Any) -> None:
    """Add completion, of all verbs that there are when it runs."""
    job = jobs.add_parser(
        "completion",
        help="print what completes sjerk in a shell",
        epilog=_HOW,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    job.add_argument("shell", choices=tuple(_SHELLS))
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    print(_SHELLS[options.shell](list(nodes("", options.parser))), end="")
    return 0


@dataclass(frozen=True)
class Option:
    """One option: all its names, its help, the choices of its value; or a value, or none."""

    names: tuple[str, ...]
    help: str
    choices: tuple[str, ...]
    takes_value: bool


@dataclass(frozen=True)
class Node:
    """What may stand behind the words ``path``: verbs with their help, or options and choices."""

    path: str
    verbs: dict[str, str]
    options: tuple[Option, ...]
    choices: tuple[str, ...]


def nodes(path: str, parser: Parser) -> Iterator[Node]:
    """The node of a parser, and those of its verbs, and of theirs."""
    options: list[Option] = []
    choices: list[str] = []
    for action in parser.arguments:
        words = () if parser.verbs else tuple(map(str, action.choices or ()))
        if action.option_strings:
            names = tuple(action.option_strings)
            options.append(Option(names, action.help or "", words, action.nargs != 0))
        else:
            choices += words
    helps = {verb: below.description or "" for verb, below in parser.verbs.items()}
    yield Node(path, helps, tuple(options), tuple(choices))
    for verb, below in parser.verbs.items():
        yield from nodes(f"{path} {verb}".strip(), below)


# ---- bash


def _words(node: Node) -> str:
    names = [name for option in node.options for name in option.names]
    return shlex.quote("\n".join([*node.verbs, *node.choices, *names]))  # a choice may have spaces


def _values(found: list[Node]) -> Iterator[tuple[str, str]]:
    """Path and option, and the words of its value; no words are a file."""
    for node in found:
        for option in node.options:
            for name in option.names if option.takes_value else ():
                yield f"{node.path}|{name}", shlex.quote("\n".join(option.choices))


_WALK = """\
_sjerk_find() {
    path=
    local word
    for word in "$@"; do
        case "|$_sjerk_paths|" in
        *"|${path:+$path }$word|"*) path="${path:+$path }$word" ;;
        esac
    done
}
"""


def _tables(found: list[Node]) -> str:
    paths = shlex.quote("|".join(node.path for node in found if node.path))
    words = "\n".join(f"    {shlex.quote(node.path)}) words={_words(node)} ;;" for node in found)
    values = "\n".join(f"    {shlex.quote(at)}) words={words} ;;" for at, words in _values(found))
    return f"""\
_sjerk_paths={paths}
{_WALK}
_sjerk_words() {{
    case "$1" in
{words}
    esac
}}
_sjerk_values() {{
    case "$1" in
{values}
    *) return 1 ;;
    esac
}}
"""


def bash(found: list[Node]) -> str:
    """The script for bash.

    >>> bash([Node("", {"move": "go"}, (), ())]).splitlines()[-1]
    'complete -o default -F _sjerk sjerk'
    """
    return f"""\
# Completion of sjerk in bash, made by `sjerk completion bash`.
{_tables(found)}
_sjerk() {{
    local words= path= current=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}}
    _sjerk_find "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"
    _sjerk_values "$path|$before" || _sjerk_words "$path"
    local IFS=$'\\n'
    COMPREPLY=($(compgen -W "$words" -- "${{current//\\\\/}}"))
    COMPREPLY=("${{COMPREPLY[@]// /\\\\ }}")
}}
complete -o default -F _sjerk sjerk
"""


# ---- zsh


def zsh(found: list[Node]) -> str:
    """The script for zsh, a file of its ``$fpath`` by the name ``_sjerk``.

    >>> zsh([Node("", {"move": "go"}, (), ())]).splitlines()[0]
    '#compdef sjerk'
    """
    shown = "\n".join(_described(node) for node in found)
    return f"""\
#compdef sjerk
# Completion of sjerk in zsh, made by `sjerk completion zsh`.
{_tables(found)}
_sjerk_described() {{
    case "$1" in
{shown}
    esac
}}
_sjerk() {{
    local path= current=$words[CURRENT] before=$words[CURRENT-1]
    local -a given shown
    given=("${{(@)words[2,CURRENT-1]}}")
    _sjerk_find "${{given[@]}}"
    local words=
    if _sjerk_values "$path|$before"; then
        if [[ -n $words ]]; then
            compadd -- ${{(f)words}}
        else
            _files
        fi
        return
    fi
    _sjerk_described "$path"
    if [[ $current == -* ]] || (( ${{#shown[(r)[^-]*]}} )); then
        _describe sjerk shown
    else
        _files
    fi
}}
if [[ $funcstack[1] == _sjerk ]]; then
    _sjerk "$@"
else
    compdef _sjerk sjerk
fi
"""


def _described(node: Node) -> str:
    rows = [*node.verbs.items(), *((choice, "") for choice in node.choices)]
    rows += [(name, option.help) for option in node.options for name in option.names]
    words = " ".join(shlex.quote(f"{word}:{_plain(text)}") for word, text in rows)
    return f"    {shlex.quote(node.path)}) shown=({words}) ;;"


def _plain(text: str) -> str:
    return text.replace("%%", "%").replace(":", "\\:")


# ---- fish


def fish(found: list[Node]) -> str:
    """The script for fish.

    >>> print(fish([Node("", {"move": "go"}, (), ())]).splitlines()[-1])
    complete -c sjerk -n "test (_sjerk_path) = ''" -f -a move -d go
    """
    paths = " ".join(shlex.quote(node.path) for node in found if node.path)
    lines = [_FISH.format(paths=paths)]
    for node in found:
        here = f"complete -c sjerk -n \"test (_sjerk_path) = '{node.path}'\""
        for verb, text in node.verbs.items():
            lines.append(f"{here} -f -a {verb} -d {_fish_quoted(text)}")
        if node.choices:
            lines.append(f"{here} -f -a {_fish_list(node.choices)}")
        for option in node.options:
            names = " ".join(
                f"-l {name[2:]}" if name.startswith("--") else f"-s {name[1:]}"
                for name in option.names
            )
            value = " -r" if option.takes_value else ""
            if option.choices:
                value = f" -x -a {_fish_list(option.choices)}"
            lines.append(f"{here} {names}{value} -d {_fish_quoted(option.help)}")
    return "\n".join(lines) + "\n"


_FISH = """\
# Completion of sjerk in fish, made by `sjerk completion fish`.
function _sjerk_path
    set -l path ''
    for word in (commandline -opc)[2..-1]
        set -l longer (string trim -- "$path $word")
        contains -- $longer {paths}; and set path $longer
    end
    echo "$path"
end"""


def _fish_quoted(text: str) -> str:
    r"""A word of fish, in which only \ and ' are special between quotes."""
    plain = text.replace("%%", "%").replace("\\", "\\\\").replace("'", "\\'")
    return plain if plain.isalnum() else f"'{plain}'"


def _fish_list(words: tuple[str, ...]) -> str:
    """A list for -a, which fish takes apart itself: each word is quoted in it."""
    return _fish_quoted(" ".join(map(_fish_quoted, words)))


_SHELLS = {"bash": bash, "zsh": zsh, "fish": fish}
