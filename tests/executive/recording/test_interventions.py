"""The chain of what operators did: a changed entry and one that was left out are found."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from recorded_events import SUCCEEDED, write

from pomona.executive.cli import main
from pomona.executive.encode import encoded
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.interventions import INTERVENTIONS, EntryChain, interventions, read_log
from pomona.executive.recording.recorder import new_writer
from pomona.executive.running.events import OperatorActed

ACTS = tuple(OperatorActed(0.5 * n, 25 * n, "anna", action) for n, action in enumerate(("take", "pause", "resume")))


def entries() -> list[bytes]:
    chain = EntryChain()
    return [*(encoded(chain.add(act)) for act in ACTS), encoded(chain.close())]


def test_a_log_that_nobody_touched_holds() -> None:
    log = read_log(entries())
    assert (log.acts, log.closed, log.problem) == (ACTS, True, "")
    assert len(log.digest) == 64


def test_each_changed_byte_and_each_entry_left_out_doubled_or_moved_is_found() -> None:
    good, rng = entries(), random.Random(3)
    digests = read_log(good).digest
    for number, entry in enumerate(good):
        for at in range(len(entry)):
            changed = entry[:at] + bytes([entry[at] ^ rng.randrange(1, 256)]) + entry[at + 1 :]
            log = read_log([*good[:number], changed, *good[number + 1 :]])
            assert log.problem or log.digest != digests  # of the last entry, the digest alone tells
        assert read_log([*good[:number], *good[number + 1 :]]).problem
        assert read_log([*good[: number + 1], *good[number:]]).problem
        other = rng.choice([n for n in range(len(good)) if n != number])
        swapped = list(good)
        swapped[number], swapped[other] = swapped[other], swapped[number]
        assert read_log(swapped).problem


def rewritten(
    path: Path, drop: int | None = None, change: tuple[bytes, bytes] = (b"", b""), both: bool = False
) -> None:
    """The record again, with right checksums, without its entry `drop` or with a word changed in the log."""
    with path.open("rb") as stream:
        found = [(c.topic, m.log_time, m.data) for _s, c, m in make_reader(stream).iter_messages(log_time_order=False)]
    with path.open("wb") as output:
        writer, channels, number = new_writer(output, CompressionType.NONE), {}, 0
        writer.start()
        for topic, stamp, data in found:
            if topic == INTERVENTIONS:
                number += 1
                if number - 1 == drop:
                    continue
            if topic == INTERVENTIONS or both:
                data = data.replace(*change)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()


def test_in_a_record_with_right_checksums_a_left_out_or_changed_entry_is_found_100_times_of_100(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(5)
    path = write(tmp_path / "run", (SUCCEEDED[0], *ACTS, SUCCEEDED[1])) / EVENTS_FILE
    assert interventions(path, cut=False).acts == ACTS
    assert digest(path.parent).state == "ended"
    whole, found = path.read_bytes(), 0
    for number in range(100):
        path.write_bytes(whole)
        if number % 2:
            rewritten(path, drop=rng.randrange(len(ACTS) + 1))
        else:
            old, new = rng.choice([(b"anna", b"anne"), (b"pause", b"stop!"), (b'"t":0.5', b'"t":0.6')])
            rewritten(path, change=(old, new), both=rng.random() < 0.5)
        found += digest(path.parent).state == "damaged"
    assert found == 100
    assert main(["explain", str(path.parent)]) == 2
    assert "log of interventions" in capsys.readouterr().err


def test_a_record_shows_what_was_done_and_the_digest_of_its_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write(tmp_path / "run", (SUCCEEDED[0], *ACTS, SUCCEEDED[1]))
    assert main(["runs", "show", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "0.50 s anna: pause" in said
    assert interventions(folder / EVENTS_FILE, cut=False).digest in said
