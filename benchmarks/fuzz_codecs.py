"""Damaged frames and streams against the codecs: `python -m benchmarks.fuzz_codecs [FRAMES] [SEED]`.

Every stream mixes intact frames with damage (flipped bits, dropped bytes, cut frames, garbage) and arrives in random
pieces. Only the typed exceptions may come, and every intact frame must be found, in order. Undetectable frames are
counted apart: behind a damaged frame whose 16-bit checksum fits by chance (WSG), or a message that lost bytes and ends
at a cut of the stream (simple message has no checksum, and TCP loses nothing).
"""

from __future__ import annotations

import contextlib
import random
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.devices.emulators.suntouch import encode
from pomona.devices.motoman import codec as motoman
from pomona.devices.suntouch import codec as suntouch
from pomona.devices.wsg import codec as wsg, frame as wsg_frame
from pomona.executive.cell.owner import Malformed


@dataclass(slots=True)
class FramesLost:
    """Counts for the frames of one codec."""

    codec: str
    frames: int = 0
    intact: int = 0
    recovered: int = 0
    forged: int = 0
    excused: int = 0

    @property
    def missed(self) -> int:
        """Intact frames that were lost without an excuse."""
        return self.intact - self.recovered - self.excused


def damage(frame: bytes, rng: random.Random) -> bytes:
    """One damaged copy of a frame; never the frame itself."""
    kind = rng.randrange(4)
    at = rng.randrange(len(frame))
    if kind == 0:
        flipped = bytearray(frame)
        for _ in range(rng.randint(1, 4)):
            flipped[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        damaged = bytes(flipped)
    elif kind == 1:
        damaged = frame[:at] + frame[at + rng.randint(1, 4) :]
    elif kind == 2:
        damaged = frame[:at]
    else:
        damaged = rng.randbytes(rng.randint(1, 30))
    return damaged if damaged != frame else frame[:-1]


def pieces(stream: bytes, rng: random.Random) -> list[bytes]:
    """The stream as it may arrive."""
    cut, at = [], 0
    while at < len(stream):
        size = rng.randint(1, 40)
        cut.append(stream[at : at + size])
        at += size
    return cut


def _match(sent: Sequence[object], found: Sequence[object]) -> tuple[int, int]:
    """How many of `sent` are in `found` in order, and how many found ones are none of them."""
    place, matched = 0, 0
    for item in sent:
        try:
            where = found.index(item, place)
        except ValueError:
            continue
        matched, place = matched + 1, where + 1
    return matched, len(found) - matched


def _wsg_frame(rng: random.Random) -> bytes:
    if rng.random() < 0.5:
        values = (rng.uniform(0.0, 0.1),)
        return wsg.encode_reply(wsg.Reply(wsg.Command.WIDTH, wsg.Status.SUCCESS, values))
    return wsg.encode(wsg.Move(rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.4)))


def _motoman_message(rng: random.Random) -> motoman.Message:
    q = tuple(np.float32(rng.uniform(-3.0, 3.0)).item() for _ in range(10))
    if rng.random() < 0.5:
        return motoman.Message(motoman.JointFeedback(0, 3, 1.0, q), motoman.Communication.TOPIC)
    body = motoman.MotionReply(0, rng.randrange(1000), 14, 0, 0)
    return motoman.Message(body, motoman.Communication.REPLY, 1)


def fuzz_wsg(frames: int, seed: int) -> FramesLost:
    """Test the WSG's decoder, and the decoding of the frames that it finds."""
    rng, report = random.Random(seed), FramesLost("wsg")
    while report.frames < frames:
        sent, stream = [], b""
        for _ in range(20):
            frame = _wsg_frame(rng)
            if rng.random() < 0.5:
                sent.append(frame)
            else:
                frame = damage(frame, rng)
            stream += frame
        decoder = wsg_frame.FrameDecoder()
        found = [
            f for piece in pieces(stream, rng) for f in decoder.decode(piece)
        ] + decoder.flush()
        for f in found:
            for decode in (wsg.decode_reply, wsg.decode_request):
                with contextlib.suppress(Malformed):
                    decode(f)
        matched, forged = _match(sent, [wsg_frame.encode_frame(f) for f in found])
        _count(report, 20, len(sent), matched, forged, excuse=forged > 0)
    return report


def fuzz_motoman(frames: int, seed: int) -> FramesLost:
    """The simple message decoder in both byte orders."""
    rng, report = random.Random(seed), FramesLost("motoman")
    while report.frames < frames:
        order: motoman.Order = rng.choice(("<", ">"))
        sent, stream, lost_bytes = [], b"", False
        for _ in range(20):
            message = _motoman_message(rng)
            packed = motoman.encode(message, order)
            if rng.random() < 0.5:
                sent.append(message)
            else:
                packed = damage(packed, rng)
                lost_bytes = True
            stream += packed
        decoder = motoman.MessageDecoder(order)
        found = [
            m for piece in pieces(stream, rng) for m in decoder.decode(piece)
        ] + decoder.flush()
        with contextlib.suppress(Malformed):
            decoder.complain()
        matched, forged = _match(sent, found)
        _count(report, 20, len(sent), matched, forged, excuse=lost_bytes and forged > 0)
    return report


def fuzz_suntouch(frames: int, seed: int) -> FramesLost:
    """Answers of a finger, each after its own request."""
    rng, report = random.Random(seed), FramesLost("suntouch")
    assembler = suntouch.Assembler()
    while report.frames < frames:
        answer = encode(np.array([rng.uniform(0.1, 3.2) for _ in range(25)]))
        intact = rng.random() < 0.5
        assembler.expect()
        reading = None
        try:
            for piece in pieces(answer if intact else damage(answer, rng), rng):
                reading = assembler.decode(piece) or reading
        except Malformed:
            pass
        right = reading is not None and np.array_equal(reading.volts, suntouch.decode(answer).volts)
        _count(report, 1, int(intact), int(intact and right), 0, excuse=False)
    return report


def _count(
    report: FramesLost, frames: int, intact: int, matched: int, forged: int, excuse: bool
) -> None:
    report.frames += frames
    report.intact += intact
    report.recovered += matched
    report.forged += forged
    report.excused += intact - matched if excuse else 0


FUZZERS: tuple[Callable[[int, int], FramesLost], ...] = (fuzz_wsg, fuzz_motoman, fuzz_suntouch)


def main() -> None:
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    for fuzz in FUZZERS:
        began = time.perf_counter()
        report = fuzz(frames, seed)
        print(
            f"{report.codec:9} {report.frames} frames, {report.intact} intact: {report.recovered} recovered, "
            f"{report.missed} missed, {report.excused} behind chance matches, {report.forged} damaged ones taken for "
            f"frames, {time.perf_counter() - began:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
