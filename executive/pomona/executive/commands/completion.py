"""`pomona completion`: completion for shells, and the manual page, from the parsers themselves."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pomona.executive.commands.command_line import children, command_names, make_parser
from pomona.executive.terminal.filtered import Filtered
from pomona.executive.values.installation import distribution, installed_version
from pomona.executive.values.shipped import installed_trees


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("completion", help="completion for bash, zsh or fish; the manual page")
    parser.add_argument("what", choices=tuple(WRITERS), help="a shell, or 'man': the manual page (roff)")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Print the completion or the manual page."""
    text = WRITERS[options.what](make_parser(command_names()))
    out = sys.stdout.unfiltered if isinstance(sys.stdout, Filtered) else sys.stdout
    out.write(text)  # a script: not a byte of it may be changed
    return 0


@dataclass(frozen=True, slots=True)
class CommandWords:
    """The words that may follow a command: `path` is "" for pomona itself, else for example "runs list".

    `values` are the words after an option, or (below "") for a positional; without values, files are completed.
    """

    path: str
    commands: dict[str, str]
    options: dict[str, str]
    values: dict[str, tuple[str, ...]]


def words_of(parser: argparse.ArgumentParser, path: str = "") -> Iterator[CommandWords]:
    """Of a parser and of all below it."""
    below = list(children(parser))
    options: dict[str, str] = {}
    values: dict[str, tuple[str, ...]] = {}
    for action in parser._actions:
        if action.help == argparse.SUPPRESS or isinstance(action, argparse._SubParsersAction):
            continue
        found = _values(action)
        for name in action.option_strings:
            options[name] = _plain(action.help)
            if found or action.nargs != 0:
                values[name] = found
        if not action.option_strings and found:
            values[""] = (*values.get("", ()), *found)
    yield CommandWords(path, {name: about for name, about, _child in below}, options, values)
    for name, _about, child in below:
        yield from words_of(child, f"{path} {name}".strip())


def _values(action: argparse.Action) -> tuple[str, ...]:
    if action.choices is not None:
        return tuple(str(choice) for choice in action.choices)
    folder = installed_trees()
    if action.dest == "tree":
        return tuple(sorted(path.stem for path in folder.glob("*.yaml")))
    if action.dest == "cell":
        return tuple(sorted(path.stem for path in (folder / "cells").glob("*.yaml")))
    return ("last",) if action.dest == "run" else ()


def _plain(text: str | None) -> str:
    return (text or "").replace("%%", "%").replace("\n", " ")


def bash(parser: argparse.ArgumentParser) -> str:
    """Return the script for bash: words by the typed prefix, files without words."""
    cases, values = [], []
    for words in words_of(parser):
        offered = " ".join([*words.commands, *words.options, *words.values.get("", ())])
        cases.append(f'    "{words.path}") words="{offered}" ;;')
        for name, found in words.values.items():
            if name:
                files = int(not found or name == "--cell")
                values.append(f'    "{words.path}|{name}") words="{" ".join(found)}"; files={files} ;;')
    paths = " ".join(f'"{words.path}"' for words in words_of(parser) if words.path)
    return f"""# bash completion for pomona; made by `pomona completion bash`
_pomona() {{
  local words="" files=1 path="" word cur="${{COMP_WORDS[COMP_CWORD]}}" prev="${{COMP_WORDS[COMP_CWORD-1]}}" known
  local paths=({paths})
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    for known in "${{paths[@]}}"; do [[ "$known" == "${{path:+$path }}$word" ]] && path="$known" && break; done
  done
  case "$path" in
{chr(10).join(cases)}
  esac
  case "$path|$prev" in
{chr(10).join(values)}
  esac
  COMPREPLY=($(compgen -W "$words" -- "$cur"))
  [[ $files == 1 && "$cur" != -* ]] && COMPREPLY+=($(compgen -f -- "$cur"))
  return 0
}}
complete -o filenames -F _pomona pomona
"""


def zsh(parser: argparse.ArgumentParser) -> str:
    """For zsh: bash's, which zsh can run."""
    return f"#compdef pomona\nautoload -U +X bashcompinit && bashcompinit\n{bash(parser)}"


def fish(parser: argparse.ArgumentParser) -> str:
    """Return the script for fish: one line per word, with its description."""
    lines = ["# fish completion for pomona; made by `pomona completion fish`"]
    for words in words_of(parser):
        typed = words.path.split()
        here = "; and ".join(f"__fish_seen_subcommand_from {word}" for word in typed)
        if words.commands:
            none = f"not __fish_seen_subcommand_from {' '.join(words.commands)}"
            here_only = f"{here}; and {none}" if here else none
            for name, about in words.commands.items():
                lines.append(f"complete -c pomona -n '{here_only}' -a {name} -d {_quoted(about)}")
        for name, about in words.options.items():
            form = f"-l {name[2:]}" if name.startswith("--") else f"-s {name[1:]}"
            takes = f" -r -a '{' '.join(words.values[name])}'" if words.values.get(name) else ""
            takes = takes or (" -r" if name in words.values else "")
            where = f" -n '{here}'" if here else ""
            lines.append(f"complete -c pomona{where} {form}{takes} -d {_quoted(about)}")
        if found := words.values.get("", ()):
            lines.append(f"complete -c pomona -n '{here}' -a '{' '.join(found)}'")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


def man(parser: argparse.ArgumentParser) -> str:
    """Return the manual page, in roff."""
    lines = [
        f'.TH POMONA 1 "" "{distribution()} {installed_version()}"',
        ".SH NAME",
        "pomona \\- " + _roff(parser.description or ""),
    ]
    lines += [".SH SYNOPSIS", ".B pomona", "COMMAND [OPTION]...", ".SH COMMANDS"]
    lines += _man_of(parser, "pomona")
    if parser.epilog:
        lines += [".SH NOTES", _roff(parser.epilog)]
    return "\n".join(lines) + "\n"


def _man_of(parser: argparse.ArgumentParser, path: str) -> Iterator[str]:
    for name, about, child in children(parser):
        whole = f"{path} {name}"
        yield from (f".SS {_roff(whole)}", _roff(about))
        for action in child._actions:
            if action.help == argparse.SUPPRESS or isinstance(action, argparse._SubParsersAction):
                continue
            metavar = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
            form = ", ".join(action.option_strings) or metavar
            value = f" {metavar}" if action.option_strings and action.nargs != 0 else ""
            yield from (".TP", f".B {_roff(form + value)}", _roff(_plain(action.help)) or "\\&")
        if child.epilog and "examples:" in child.epilog:
            yield from (".PP", "Examples:", ".nf", _roff(child.epilog.partition("examples:\n")[2]), ".fi")
        yield from _man_of(child, whole)


def _roff(text: str) -> str:
    """Return text that roff takes for text: a line must not begin with a dot or a quote."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    escaped = "".join(letter if letter.isascii() else f"\\[u{ord(letter):04X}]" for letter in escaped)
    return "\n".join(f"\\&{line}" if line.startswith((".", "'")) else line for line in escaped.split("\n"))


WRITERS = {"bash": bash, "zsh": zsh, "fish": fish, "man": man}
