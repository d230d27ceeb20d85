"""The frame of a package, and the tree of its example."""

from __future__ import annotations

from pomona.tools.kit.piece import Piece

PACKAGE = Piece(
    "a package with the files for pip, pytest and mypy",
    {
        "pyproject.toml": """[build-system]
requires = ["hatchling>=1.27"]
build-backend = "hatchling.build"

[project]
name = "$module"
version = "0.1.0"
requires-python = ">=3.11"
dependencies = []  # neither pomona nor pomona-executive: both hold the executive, and the user's environment has one

[project.optional-dependencies]
dev = ["pytest>=8.2", "mypy>=1.13"]

[tool.hatch.build.targets.wheel]
packages = ["$module"]

[tool.mypy]
strict = true

[tool.pytest.ini_options]
testpaths = ["tests"]
pythonpath = ["."]
""",
        "$module/__init__.py": '"""$Name: skills, drivers and words of trees for Pomona."""\n',
        "$module/py.typed": "",
        "README.md": """# $module

In an environment with Pomona (the distribution pomona or pomona-executive):

    pip install -e '.[dev]'
    pomona skills            # lists the skills of this package, too
    pytest
    mypy $module

`pomona new skill|node|driver|gripper|arm NAME --into .` adds a piece.
Install the package once more after that: its new name is found then.
""",
    },
)

TREE = Piece(
    "a tree with the example's skill, and its tests",
    {
        "trees/${module}_test.yaml": """# The expected events, with a mock as the skill: pomona test trees/*_test.yaml
# Its common mocks also serve a run: pomona run trees/$module.yaml --dry trees/${module}_test.yaml
pomona: 1
tree: $module.yaml

mocks:
  $Name: {after: 100 ms, outputs: {height: 15 cm}}

cases:
  - name: high enough
    expect: success
  - name: the skill refuses
    mocks: {$Name: TOO_HIGH}
    expect: {status: failure, code: TOO_HIGH}
  - name: lower than the check asks
    mocks: {$Name: {outputs: {height: 5 cm}}}
    expect: {status: failure, code: CONDITION_FALSE}
""",
        "trees/$module.yaml": """# A tree to begin with: pomona run trees/$module.yaml
pomona: 1
tree: $module

parameters:
  above: {type: length, default: 5 cm, help: on top of the least height}

root:
  sequence:
    - $Name: {above: "{above}", height: "{height}"}
      timeout: 5 s
    - check: "{height} > 10 cm"
""",
    },
)

OWN_TREE = Piece(
    "a tree to begin with",
    {
        "$name.yaml": """# Move the arm to a pose of the cell and wait there: pomona run $name.yaml
pomona: 1
tree: $name

parameters:
  pause: {type: time, default: 1 s, help: at the pose}

root:
  sequence:
    - MoveTo: {pose: observe}
    - wait: "{pause}"
""",
    },
)

EMPTY_TREE = Piece(
    "a tree to begin with, where no skill is installed",
    {
        "$name.yaml": """# Wait, then end: pomona run $name.yaml --dry
pomona: 1
tree: $name

parameters:
  pause: {type: time, default: 1 s, help: before the end}

root:
  sequence:
    - wait: "{pause}"
""",
    },
)
