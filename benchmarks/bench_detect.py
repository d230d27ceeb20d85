"""Detect against its figures: held-out rendered frames, and speed against DOPE's full network in the same run.

python -m benchmarks.bench_detect --frames 1000
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import Progress

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.instances import find_instances
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.pytorch.dope_decode import decode_maps
from pomona.tools.pytorch.networks import DopeNetwork, dope_input
from pomona.tools.training.dataset import render_dataset
from pomona.tools.training.evaluation import evaluate, table
from pomona.tools.training.options import WITHOUT_TREES, SceneOptions
from pomona.tools.training.samples import FrameFolder

BENCH_SEED = 777_001
"""Neither trained nor validated on."""

ROUNDS = 3  # turns of both networks


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=1000, help="held-out frames (1000)")
    parser.add_argument("--fruit", default="apple")
    parser.add_argument("--weights", type=Path, help="other weights than the fruit's own")
    parser.add_argument(
        "--work", type=Path, default=Path("runs/bench_detect"), help="where frames are kept"
    )
    parser.add_argument(
        "--score", type=float, default=0.6, help="score above which errors are counted (0.6)"
    )
    parser.add_argument(
        "--no-speed",
        action="store_true",
        help="leave out the full network, which takes half a minute",
    )
    options = parser.parse_args()
    fruit = load_fruit(options.fruit)
    weights = options.weights or fruit.weights
    if weights is None:
        raise SystemExit(f"there are no weights for {fruit.name}")
    detector = CompactDetector.load(weights)
    detector.warm_up()
    print(f"# Detect, {fruit.name}: {weights.name}, seed {BENCH_SEED}, {processor_name()}\n")
    trees = (0.0, 0.0, 0.0, 1.0)
    for name, kinds, count in (
        ("frames", WITHOUT_TREES, options.frames),
        ("trees", trees, max(1, options.frames // 5)),
    ):
        folder = options.work / f"{fruit.name}_{name}"
        with progress(f"rendering {name}") as shown:  # frames that are there already are kept
            scenes = SceneOptions(kinds=kinds)
            render_dataset(folder, count, BENCH_SEED, options.fruit, scenes, progress=shown)
        with progress("looking") as shown:
            result = evaluate(detector, FrameFolder([folder]), fruit, count, shown)
        median = 1e3 * np.median(result.seconds)
        print(f"## {count} rendered {name}, {median:.1f} ms each at the median, one thread\n")
        print(table(result, options.score), "\n")
    if not options.no_speed:
        print(speed(detector, FrameFolder([options.work / f"{fruit.name}_frames"]), fruit))


def processor_name() -> str:
    """The processor's name as the system gives it."""
    path = Path("/proc/cpuinfo")
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    named = (
        line.split(":", 1)[1].strip() for line in text.splitlines() if line.startswith("model name")
    )
    return next(named, platform.processor() or "unknown processor")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on the error stream, updated with (done, in all)."""
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(what)
        yield lambda done, count: bar.update(task, completed=done, total=count)


def speed(detector: CompactDetector, frames: FrameFolder, fruit: FruitModel) -> str:
    """The whole of Detect against the whole of DOPE at 640 x 480, in turns within this run."""
    full = DopeNetwork().eval()
    pictures = [frames.picture(k) for k in range(min(8, len(frames)))]
    K = frames.annotation(0).K
    threads = torch.get_num_threads()
    took: dict[int, list[float]] = {threads: [], 1: []}
    compact: list[float] = []
    for turn in range(ROUNDS):
        for count, seconds in took.items():
            torch.set_num_threads(count)
            start = time.perf_counter()
            tensor, _ = dope_input(pictures[turn % len(pictures)], downscale_height=480)
            with torch.inference_mode():
                beliefs, affinities = full(tensor)
            decode_maps(beliefs[-1][0].numpy(), affinities[-1][0].numpy())
            seconds.append(time.perf_counter() - start)
        torch.set_num_threads(threads)
        for picture in pictures:
            start = time.perf_counter()
            find_instances(detector, picture, K, fruit)
            compact.append(time.perf_counter() - start)
    own = float(np.median(compact))
    lines = ["## Speed at 640 × 480, medians of this run", "", f"all of Detect: {1e3 * own:.1f} ms"]
    for count, seconds in took.items():
        theirs = float(np.median(seconds))
        lines.append(
            f"full network with resize and decoding, {count} threads: {1e3 * theirs:.0f} ms, {theirs / own:.0f} times"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
