"""A campaign file: which tree and cell, what varies, how often.

pomona: 1
campaign: paper
tree: pick_apple
cell: sim
repetitions: 3                    # seeds 0, 1, 2
vary:                             # every combination; keys as for --set
  fruit_body: [apple_1, apple_2]
  place: [1, 2, 3]
arms:                             # what is compared: settings of each arm
  refined:   {}
  unrefined: {refine: none}
set: {others: 0}                  # the same for every run
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from executive.errors import UsageError
from executive.execute import RunOrder
from executive.files import find_cell, find_tree, read_text

KEYS = {"pomona", "campaign", "description", "tree", "cell", "repetitions", "first_seed", "vary", "arms", "set"}


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """One run of a campaign. `name` is the same whenever the campaign is planned again."""

    name: str
    arm: str
    varied: Mapping[str, str]
    order: RunOrder


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign, planned: every run in its order."""

    name: str
    description: str
    vary: Mapping[str, tuple[str, ...]]
    arms: tuple[str, ...]
    runs: tuple[CampaignRun, ...]


def read_campaign(path: Path, record: Path | None) -> Campaign:
    """Read and plan a campaign file.

    Args:
        path: the file.
        record: folder for the records of all runs, or None.

    Raises:
        UsageError: what is wrong, with its line where there is one.
    """
    try:
        content = yaml.safe_load(read_text(path))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise UsageError(f"{path}{place}: not YAML: {getattr(error, 'problem', error)}") from error
    if not isinstance(content, dict):
        raise UsageError(f"{path}: a campaign is a mapping with the keys {', '.join(sorted(KEYS))}")
    unknown = sorted(set(map(str, content)) - KEYS)
    if unknown:
        raise UsageError(f"{path}: unknown key '{unknown[0]}'; known are {', '.join(sorted(KEYS))}")
    for key in ("campaign", "tree"):
        if not isinstance(content.get(key), str):
            raise UsageError(f"{path}: '{key}' is missing")
    vary = {key: tuple(map(str, values)) for key, values in _mapping(path, content, "vary").items()}
    arms = {name: _settings(path, given) for name, given in _mapping(path, content, "arms").items()} or {"all": {}}
    common = _settings(path, content.get("set"))
    repetitions = content.get("repetitions", 1)
    first = content.get("first_seed", 0)
    if not isinstance(repetitions, int) or repetitions < 1 or not isinstance(first, int):
        raise UsageError(f"{path}: 'repetitions' is a whole number of at least 1, and 'first_seed' a whole number")
    tree, cell = find_tree(content["tree"]), find_cell(str(content.get("cell", "sim")))
    runs = []
    for arm, values, seed in itertools.product(
        arms, itertools.product(*vary.values()), range(first, first + repetitions)
    ):
        varied = dict(zip(vary, values, strict=True))
        name = "/".join([arm, *(f"{key}={value}" for key, value in varied.items()), f"seed={seed}"])
        order = RunOrder(tree, cell, seed, {**common, **varied, **arms[arm]}, record=record)
        runs.append(CampaignRun(name, arm, varied, order))
    return Campaign(content["campaign"], str(content.get("description", "")), vary, tuple(arms), tuple(runs))


def _mapping(path: Path, content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key) or {}
    if not isinstance(value, dict):
        raise UsageError(f"{path}: '{key}' must be a mapping")
    if key == "vary" and not all(isinstance(v, list) and v for v in value.values()):
        raise UsageError(f"{path}: every entry of 'vary' is a list of values")
    return {str(k): v for k, v in value.items()}


def _settings(path: Path, given: Any) -> dict[str, str]:
    if given is None:
        return {}
    if not isinstance(given, dict):
        raise UsageError(f"{path}: settings are written as {{key: value}}")
    return {str(key): str(value) for key, value in given.items()}
