"""Run by the interpreter of LeRobot's own environment: everything that it reads of a dataset, as plain arrays.

python lerobot_reads.py DATASET OUT.npz
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np


def main(dataset: str, out: str) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from torch.utils.data import DataLoader

    read = LeRobotDataset("pomona/run", root=Path(dataset))
    frames = [read[k] for k in range(len(read))]
    found: dict[str, Any] = {}
    for key in frames[0]:
        values = [frame[key] for frame in frames]
        found[key] = (
            np.array(values)
            if isinstance(values[0], str)
            else np.stack([value.numpy() for value in values])
        )
    batch = next(iter(DataLoader(read, batch_size=8)))
    found["batched_state"] = batch["observation.state"].numpy()
    found["fps"], found["episodes"] = np.array(read.fps), np.array(read.num_episodes)
    found["mean_of_state"] = np.asarray(read.meta.stats["observation.state"]["mean"])
    np.savez(out, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
