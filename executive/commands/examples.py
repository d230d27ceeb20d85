"""What people type, by subcommand: shown below its help and in the manual page."""

from __future__ import annotations

from collections.abc import Mapping

EXAMPLES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "run": (
        ("pomona run pick_apple", "pick an apple on the simulated cell"),
        ("pomona run pick_apple --pace real --dashboard", "watch and steer it in the browser"),
        ("pomona run pick_apple --set attempts=20 --seed 3", "with another parameter, another world"),
        ("pomona run my_tree.yaml --cell lab.yaml", "your own tree on your own cell"),
        ("pomona run my_tree.yaml --dry --watch", "no cell: run it again each time it is saved"),
    ),
    "check": (
        ("pomona check my_tree.yaml", "everything that is wrong with it, with line and column"),
        ("pomona check pick_apple --cell lab.yaml", "can it run on this cell?"),
    ),
    "show": (
        ("pomona show pick_apple", "draw a tree in the terminal"),
        ("pomona show pick_apple --svg tree.svg", "or as a picture"),
    ),
    "fmt": (
        ("pomona fmt my_tree.yaml", "indentation and spacing in one way; comments stay"),
        ("pomona fmt --check trees/*.yaml", "for CI: says which are not"),
    ),
    "lsp": (("pomona lsp --cell sim", "what an editor starts; poses and fruit of this cell"),),
    "new": (
        ("pomona new package my_fruit_kit", "a package with a skill, a tree and tests"),
        ("pomona new driver my_camera --into my_fruit_kit", "add a driver to it"),
        ("pomona new cell my_cell", "a cell file to begin with"),
    ),
    "dashboard": (
        ("pomona dashboard", "all recorded runs, and new ones"),
        ("ssh -L 9000:localhost:8420 robot", "then, on your machine, open the printed link with port 9000"),
        ("pomona dashboard --host 0.0.0.0 --tls-cert c.pem --tls-key k.pem", "reached from elsewhere, encrypted"),
    ),
    "explain": (
        ("pomona explain last", "why the last run failed"),
        ("pomona explain 2026-11-21_08-41-07_pick_apple", "why that one did"),
    ),
    "runs": (
        ("pomona runs list", "the recorded runs, newest first"),
        ("pomona runs show last", "what it was, how it went, what its record holds"),
    ),
    "replay": (("pomona replay last --speed 1", "show it again, as it went"),),
    "rerun": (("pomona rerun last", "does a simulated run repeat exactly?"),),
    "campaign": (
        ("pomona campaign benchmarks/pick.yaml --workers 4", "many runs and their report"),
        ("pomona campaign benchmarks/pick.yaml --report", "the report of what is there already"),
    ),
    "skills": (("pomona skills Plan", "a skill's ports, devices and failures"),),
    "doctor": (("pomona doctor --cell lab.yaml", "is the cell fit to run?"),),
    "completion": (
        ("pomona completion bash > ~/.local/share/bash-completion/completions/pomona", "for bash"),
        ("pomona completion fish > ~/.config/fish/completions/pomona.fish", "for fish"),
        ("pomona completion man > ~/.local/share/man/man1/pomona.1", "then `man pomona`"),
    ),
}
