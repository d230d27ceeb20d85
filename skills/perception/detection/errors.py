"""What can go wrong in detection outside the tree.

DetectError
├── BadFrame         a picture of the wrong shape or type
├── BadMaps          belief or affinity maps of the wrong shape
├── BadWeights       a weights file that cannot be read or does not fit the network
├── BadPoseConfig    a config_pose.yaml that cannot be read
├── BadAnnotation    an annotation file that cannot be read
├── PoseUnsolved     keypoints from which no pose follows
└── BadTraining      a training run that cannot start or continue
"""

from __future__ import annotations

from pathlib import Path


class DetectError(Exception):
    """Root of this package's errors."""


class BadFrame(DetectError):
    def __init__(self, expected: str, got: str) -> None:
        self.expected, self.got = expected, got
        super().__init__(f"a picture must be {expected}; this one is {got}")


class BadMaps(DetectError):
    def __init__(self, expected: str, got: str) -> None:
        self.expected, self.got = expected, got
        super().__init__(f"maps must be {expected}; these are {got}")


class PoseUnsolved(DetectError):
    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(f"no pose follows from the keypoints: {problem}")


class BadTraining(DetectError):
    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(problem)


class _BadFile(DetectError):
    def __init__(self, path: Path | str, problem: str) -> None:
        self.path, self.problem = Path(path), problem
        super().__init__(f"{path}: {problem}")


class BadWeights(_BadFile):
    pass


class BadPoseConfig(_BadFile):
    pass


class BadAnnotation(_BadFile):
    pass
