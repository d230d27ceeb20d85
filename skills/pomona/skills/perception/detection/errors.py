"""Errors of detection outside the tree.

DetectError
├── BadFrame         a picture of the wrong shape or type
├── BadMaps          belief or affinity maps of the wrong shape
├── BadWeights       a weights file that cannot be read or does not fit the network
├── BadPoseConfig    a config_pose.yaml that cannot be read
└── MissingPackage   a package of the extra `torch` is needed and not installed
"""

from __future__ import annotations

from pathlib import Path

from pomona.executive.values.installation import install_extra


class DetectError(Exception):
    """Root of this package's errors."""


class _Unfit(DetectError):
    words = ""

    def __init__(self, expected: str, got: str) -> None:
        self.expected = expected
        self.got = got
        super().__init__(self.words.format(expected, got))


class BadFrame(_Unfit):
    """A picture of another shape or type than the detector takes."""

    words = "a picture must be {}; this one is {}"


class BadMaps(_Unfit):
    """Maps of another shape than the decoder takes."""

    words = "maps must be {}; these are {}"


class _BadFile(DetectError):
    def __init__(self, path: Path | str, problem: str) -> None:
        self.path = Path(path)
        self.problem = problem
        super().__init__(f"{path}: {problem}")


class BadWeights(_BadFile):
    """A file of weights that cannot be used."""


class BadPoseConfig(_BadFile):
    """A configuration of DOPE's that cannot be used."""


class MissingPackage(DetectError):
    """A package that the extra `torch` brings is needed and not installed.

    Args:
        package: that is missing.
        purpose: its use here, as the rest of a sentence.
    """

    def __init__(self, package: str, purpose: str) -> None:
        self.package = package
        super().__init__(f"{package} {purpose} and is not installed: {install_extra('torch')}")
