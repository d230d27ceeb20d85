"""Example commands, by subcommand: shown below its help.

The tree, the setting and the campaign in them are the installed trees' own (`trees/defaults.toml`).
"""

from __future__ import annotations

from collections.abc import Mapping

_EXAMPLES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "run": (
        ("pomona run {tree}", "{task} on the simulated cell"),
        ("pomona run {tree} --pace real --dashboard", "watch and control the run in the browser"),
        ("pomona run {tree} --set {setting} --seed 3", "with another parameter and another random world"),
        ("pomona run my_tree.yaml --cell lab.yaml", "your own tree on your own cell"),
        ("pomona run my_tree.yaml --dry", "without a cell: every skill succeeds at once"),
    ),
    "measure": (
        ("pomona measure frames --out row_7", "count and measure the fruit in recorded RGB-D frames"),
        ("pomona measure row_color.mp4 --every 10", "the same for a video with a depth video in the same folder"),
        ("pomona measure frames --kind lemon --score 0.7", "another fruit, with a higher threshold"),
    ),
    "check": (
        ("pomona check my_tree.yaml", "list all errors with line and column"),
        ("pomona check {tree} --cell lab.yaml", "check that a tree can run on this cell"),
    ),
    "show": (
        ("pomona show {tree}", "draw a tree in the terminal"),
        ("pomona show {tree} --svg tree.svg", "or as a picture"),
    ),
    "fmt": (
        ("pomona fmt my_tree.yaml", "format indentation and spacing; comments stay"),
        ("pomona fmt --check trees/*.yaml", "for CI: list the files that are not formatted"),
    ),
    "lsp": (("pomona lsp --cell sim", "started by an editor; offers the names of this cell"),),
    "new": (
        ("pomona new package my_kit", "a package with a skill, a tree and tests"),
        ("pomona new skill Weigh --into my_kit", "add a skill to it"),
        ("pomona new node forgive --into my_kit", "add a node type to it"),
    ),
    "dashboard": (
        ("pomona dashboard", "all recorded runs, and new ones"),
        ("ssh -L 9000:localhost:8420 robot", "then, on your machine, open the printed link with port 9000"),
        ("pomona dashboard --host 0.0.0.0 --tls-cert c.pem --tls-key k.pem", "serve other machines, with TLS"),
    ),
    "explain": (
        ("pomona explain last", "the events of the last run, their causes, and a remedy"),
        ("pomona explain last --all", "all events of the last run, with values and times"),
        ("pomona explain 2026-11-21_08-41-07_{tree}", "explain the run of this record"),
    ),
    "runs": (
        ("pomona runs list", "the recorded runs, newest first"),
        ("pomona runs show last", "settings, result and contents of the record"),
    ),
    "replay": (("pomona replay last --speed 1", "show the last run in real time"),),
    "rerun": (("pomona rerun last", "check that a simulated run repeats exactly"),),
    "campaign": (
        ("pomona campaign {campaign} --workers 4", "many runs and a report"),
        ("pomona campaign {campaign} --report", "the report of the present results"),
    ),
    "skills": (("pomona skills Plan", "a skill's ports, devices and failures"),),
    "doctor": (("pomona doctor --cell lab.yaml", "check that this cell is ready for a run"),),
    "completion": (
        ("pomona completion bash > ~/.local/share/bash-completion/completions/pomona", "for bash"),
        ("pomona completion fish > ~/.config/fish/completions/pomona.fish", "for fish"),
    ),
}


def examples(command: str) -> tuple[tuple[str, str], ...]:
    """Return the examples of a subcommand with their descriptions; nothing for one without examples."""
    rows = _EXAMPLES.get(command, ())
    if not rows:
        return ()
    from pomona.executive.files import default_name  # takes an eighth of `pomona --help`, which shows none

    names = {name: default_name(name) for name in ("tree", "task", "setting", "campaign")}
    return tuple((line.format(**names), about.format(**names)) for line, about in rows)
