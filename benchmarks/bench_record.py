"""Cost of recording: whole picks with and without a record, in turns, in one process.

    python -m benchmarks.bench_record [--pairs 8] [--real 2]

Prints, with and without: the run's wall and processor time (less disturbed by a busy machine), and the wall time from
reading the tree to the closed record, with the picture that is drawn after the run; first with the simulated cell as
fast as it goes, some eight times as fast as a real one, then at the pace of a real one. Then the recorder's and the
picture's processor time alone, from the same events, and how large the record of a pick is, by topic.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections import Counter
from pathlib import Path

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.picture import Picture
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import scan
from pomona.executive.running.events import Event, RunEnded, RunStarted

Times = tuple[float, float, float]


def one(seed: int, record: Path | None, real_time: bool = False) -> tuple[Times, Path | None]:
    """Wall and processor time of one pick, wall time of everything [s], and its record."""
    order = RunOrder(
        find_tree("pick_apple"), find_cell("sim"), seed, record=record, real_time=real_time
    )
    processor: list[float] = []

    def note(event: Event) -> None:
        if isinstance(event, RunStarted | RunEnded):
            processor.append(time.process_time())

    began = time.perf_counter()
    executed = execute(order, [note])
    whole = time.perf_counter() - began
    assert executed.result.outcome == "success", executed.result.reason
    assert executed.problem == ""
    return (executed.result.wall, processor[1] - processor[0], whole), executed.record


def alone(record: Path, folder: Path) -> tuple[float, float]:
    """Processor time of recording a run's events again (not its readings), and of drawing its picture [s]."""
    events = list(read_events(record))
    folder.mkdir()
    began = time.process_time()
    recorder = Recorder(folder)
    for event in events:
        recorder.on_event(event)
    recorder.close()
    recorded = time.process_time()
    picture = Picture()
    for event in events:
        picture.on_event(event)
    picture.save(folder / "picture.png", "a pick")
    return recorded - began, time.process_time() - recorded


def compare(pairs: int, folder: Path, real_time: bool) -> list[Path]:
    """Pick with and without a record by turns; print the cost and return the records."""
    without: list[tuple[float, float, float]] = []
    recorded: list[tuple[float, float, float]] = []
    records: list[Path] = []
    for seed in range(1, pairs + 1):
        for keep in (
            (False, True) if seed % 2 else (True, False)
        ):  # the first one may run on a colder machine
            times, record = one(seed, folder if keep else None, real_time)
            (recorded if keep else without).append(times)
            if record is not None:
                records.append(record)
    print(f"{pairs} pairs, {'at the pace of a real cell' if real_time else 'as fast as it goes'}")
    for k, name in enumerate(("run, wall", "run, processor", "everything, wall")):
        ratios = [with_[k] / bare[k] for with_, bare in zip(recorded, without, strict=True)]
        bare, kept = (statistics.median(times[k] for times in many) for many in (without, recorded))
        print(
            f"  {name:24} without {bare:6.3f} s   with {kept:6.3f} s   median of the ratios {_percent(ratios)}"
        )
    return records


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--real", type=int, default=2, help="pairs at the pace of a real cell")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        one(0, Path(folder))  # compile, load, warm
        records = compare(options.pairs, Path(folder), real_time=False)
        compare(options.real, Path(folder), real_time=True)
        newest, sizes = records[-1], [(record / EVENTS_FILE).stat().st_size for record in records]
        recording, drawing = alone(newest, Path(folder) / "again")
        print(
            f"alone, processor: recording {1e3 * recording:.0f} ms, drawing the picture {1e3 * drawing:.0f} ms"
        )
        print(
            f"a pick's record: median {statistics.median(sizes) / 1e6:.2f} MB, largest {max(sizes) / 1e6:.2f} MB"
        )
        topics: Counter[str] = Counter()
        for topic, content, *_ in scan(newest / EVENTS_FILE):
            topics["/".join(topic.split("/")[:2])] += len(content)
        print(
            "of which "
            + ", ".join(f"{topic} {size / 1e6:.2f} MB" for topic, size in topics.most_common())
        )


def _percent(ratios: list[float]) -> str:
    middle, least, most = (
        100 * (value - 1) for value in (statistics.median(ratios), min(ratios), max(ratios))
    )
    return f"{middle:+.1f} % ({least:+.1f} … {most:+.1f})"


if __name__ == "__main__":
    main()
