"""A verdict on a record's file, and its messages.

A record is trusted as a whole or not at all. A finished file of Pomona has checksums over every byte, so two sums and
its summary are enough. Any other file is checked record by record; one that was cut off is trusted up to there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
)

from pomona.executive.errors import UsageError
from pomona.executive.recording.mcap_file import (
    HEAD,
    LIBRARY,
    MAGIC,
    CutError,
    DamagedError,
    RawRecord,
    crc_of,
    decode,
    has_begun,
    next_chunk,
    only_zeros_follow,
    raw_record_at,
    raw_records,
    records_of,
    size_of,
)
from pomona.executive.recording.plain_file import open_plain

REPAIR = "pomona.repair"  # name of the metadata that lists the parts that a repair could not save

REMEDY = "`pomona runs repair` saves the undamaged parts"

_TAIL = HEAD.size + 20 + len(MAGIC)  # size of the footer with the closing magic [bytes]


class DamagedRecordError(UsageError):
    """A run's record fails its checks, so nothing in it is trusted."""


class Found(NamedTuple):
    """One message."""

    topic: str  # topic of its channel
    content: bytes  # its bytes
    stamp: int  # time on the run's clock [ns]
    sequence: int  # number of the event on `/events`, from 1; 0 on other topics and in records of earlier versions


class ChunkPlace(NamedTuple):
    """Offset of a chunk in the file, its oldest and its newest stamp [ns]."""

    at: int
    oldest: int
    newest: int


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of an examination."""

    state: str  # whole, cut off (whole up to there) or damaged
    why: str = ""  # the problem as a phrase; empty for a whole file
    t: float = 0.0  # run time up to which the file is whole [s]
    good: int = 0  # number of bytes up to which the file is whole
    # every byte up to `good` has a checksum. Files of earlier versions and of other programs may have none.
    checked: bool = True
    # the parts that an earlier repair could not save, as a phrase; empty without loss
    lost: str = ""
    attachments: Mapping[str, int] = field(
        default_factory=dict
    )  # offset of the newest attachment of each name
    # the chunks of a file of this recorder, which holds all messages; else None
    chunks: tuple[ChunkPlace, ...] | None = None
    # topics by channel number. A chunk at the end of a cut file may declare further ones.
    topics: Mapping[int, str] = field(default_factory=dict)


def examine(path: Path) -> Verdict:
    """Check every byte of a file. Raises UsageError: it is not an MCAP file, or cannot be read."""
    try:
        with open_plain(path) as stream:
            return _examined(path, stream)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def is_whole(path: Path) -> bool:
    """Return True for an MCAP file that is finished and unchanged.

    Raises UsageError: it is not an MCAP file, or cannot be read.
    """
    return examine(path).state == "whole"


def require_valid(path: Path) -> Verdict:
    """Return the verdict on a file that can be trusted, at least up to the point where it was cut off.

    Raises DamagedRecordError: it is damaged; UsageError: it is not an MCAP file, or cannot be read.
    """
    verdict = examine(path)
    if verdict.state == "damaged":
        raise _untrusted(path, verdict.why)
    return verdict


def scan(
    path: Path,
    verdict: Verdict | None = None,
    *,
    topics: Callable[[str], bool] | None = None,
    begin: int = 0,
    end: int = 2**64,
) -> Iterator[Found]:
    """Yield the messages in the order of the file; of a record that was cut off, those up to there.

    Args:
        verdict: result of `require_valid`, if it is known already.
        topics: returns True for a topic that is wanted; None: all are.
        begin: oldest stamp that is wanted [ns].
        end: newest stamp that is wanted [ns].

    Raises:
        DamagedRecordError: a part of the file is damaged.
        UsageError: it is not an MCAP file, or cannot be read.
    """
    verdict = verdict or require_valid(path)
    names = dict(verdict.topics)
    wanted = {number for number, name in names.items() if topics is None or topics(name)}
    try:
        with open_plain(path) as stream:
            for raw in _trusted_records(stream, verdict, begin, end):
                for record in records_of(raw):
                    if isinstance(record, Channel):
                        names[record.id] = record.topic
                        if topics is None or topics(record.topic):
                            wanted.add(record.id)
                    elif isinstance(record, Message):
                        if record.channel_id in wanted and begin <= record.log_time <= end:
                            yield Found(
                                names[record.channel_id],
                                record.data,
                                record.log_time,
                                record.sequence,
                            )
                        elif record.channel_id not in names:
                            raise DamagedError(
                                raw.at, f"channel {record.channel_id} of a message is not declared"
                            )
    except (
        CutError,
        DamagedError,
    ) as error:  # changed since the examination, or damage within a chunk
        raise _untrusted(path, str(error)) from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def attachment(path: Path, name: str, verdict: Verdict) -> bytes | None:
    """Return the newest attachment of this name in a trusted file, or None.

    Raises UsageError: the file cannot be read.
    """
    at = verdict.attachments.get(name)
    if at is None:
        return None
    try:
        with open_plain(path) as stream:
            (found,) = records_of(raw_record_at(stream, at))
    except (CutError, DamagedError) as error:
        raise _untrusted(path, str(error)) from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    return bytes(found.data) if isinstance(found, Attachment) and found.name == name else None


def _untrusted(path: Path, why: str) -> DamagedRecordError:
    return DamagedRecordError(f"{path}: the record is damaged and is not trusted: {why}. {REMEDY}")


def _trusted_records(
    stream: BinaryIO, verdict: Verdict, begin: int, end: int
) -> Iterator[RawRecord]:
    """Yield the chunks of an interval of time [ns] by the index; without one, every record up to `verdict.good`."""
    if verdict.chunks is not None:
        size = size_of(stream)
        read = 0
        for chunk in verdict.chunks:
            if chunk.oldest <= end and chunk.newest >= begin:
                if chunk.at < read:  # a forged index must not multiply the cost of reading
                    raise DamagedError(chunk.at, "the chunks of the index overlap")
                raw = raw_record_at(stream, chunk.at, size)
                read = raw.end
                yield raw
        return
    for raw in raw_records(stream) if verdict.good > len(MAGIC) else ():
        if raw.opcode in (Opcode.CHUNK, Opcode.CHANNEL, Opcode.MESSAGE):
            yield raw
        if raw.end >= verdict.good:
            return


# ------------------------------------------------------------------------------------------------- examination


class _End(NamedTuple):
    """End of a finished file: offset of the data's end, problem of a checksum, and whether one is missing."""

    at: int
    problem: str
    unchecked: bool


def _examined(path: Path, stream: BinaryIO) -> Verdict:
    if not has_begun(path, stream):
        return Verdict("cut off", "the file ends within its header")
    end = _end_of(stream)
    sealed = (
        end is not None and not end.problem and not end.unchecked and _library_of(stream) == LIBRARY
    )
    return _Walk(stream, len(MAGIC) if end is None or not sealed else end.at).verdict(end)


def _end_of(stream: BinaryIO) -> _End | None:
    """Compare the checksums of data and summary; None for a file without a complete end."""
    size = size_of(stream)
    try:
        tail = raw_record_at(stream, max(size - _TAIL, 0), size)
        footer = decode(tail)
        closing = stream.read()
        at = (
            (footer.summary_start or tail.at) - HEAD.size - 4
            if isinstance(footer, Footer)
            else size
        )
        data_end = decode(raw_record_at(stream, max(at, 0), size))
    except (CutError, DamagedError):
        return None
    if closing != MAGIC or not isinstance(data_end, DataEnd) or not isinstance(footer, Footer):
        return None
    required = _library_of(stream) == LIBRARY
    unchecked = False
    for what, begin, end, written in (
        ("data as a whole do", 0, at, data_end.data_section_crc),
        ("summary does", at + HEAD.size + 4, size - len(MAGIC) - 4, footer.summary_crc),
    ):
        matches = crc_of(stream, begin, end) == written
        if not matches and (required or written):
            return _End(
                at, f"the {what} not match {'their' if begin == 0 else 'its'} checksum", False
            )
        unchecked |= not matches
    return _End(at, "", unchecked)


def _library_of(stream: BinaryIO) -> str:
    """Return the name of the library that wrote the file; empty if its header cannot be decoded."""
    try:
        header = decode(raw_record_at(stream, len(MAGIC)))
    except (CutError, DamagedError):
        return ""
    return header.library if isinstance(header, Header) else ""


class _Walk:
    """Checks a file record by record: its summary alone if the checksums of the whole file match."""

    def __init__(self, stream: BinaryIO, begin: int) -> None:
        self._stream, self._begin, self._indexed = stream, begin, begin > len(MAGIC)
        self._required = _library_of(stream) == LIBRARY
        self._good = begin
        self._stamp = 0
        self._lost = ""
        self._checked = True
        self._data_ended = False
        self._attachments: dict[str, int] = {}
        self._topics: dict[int, str] = {}
        self._chunks: list[ChunkPlace] = []
        self._chunk: RawRecord | None = None

    def verdict(self, end: _End | None) -> Verdict:
        """Return the verdict; `end` is the result of `_end_of`."""
        try:
            for raw in raw_records(self._stream, self._begin):
                self._take(raw, decode(raw))
                self._good = raw.end
                if raw.opcode == Opcode.FOOTER:
                    break
        except CutError as error:
            return self._ended_within(error.at)
        except DamagedError as error:
            if only_zeros_follow(self._stream, error.at):
                return self._made(
                    "cut off", f"only zeros follow after {error.at} bytes, as after a power failure"
                )
            return self._made("damaged", f"{error}, at {self._stamp / 1e9:.2f} s of the run")
        if end is None:
            self._stream.seek(self._good)
            closing = self._stream.read(len(MAGIC))
            if len(closing) < len(MAGIC) and MAGIC.startswith(closing):
                return self._made("cut off", "its summary is missing")
            return self._made(
                "damaged", f"it does not end as an MCAP file (byte {self._good} of the file)"
            )
        if end.problem:
            return self._made("damaged", f"{end.problem} (byte {end.at} of the file)")
        self._checked &= not end.unchecked
        return self._made("whole", "")

    def _take(self, raw: RawRecord, record: McapRecord) -> None:
        match record:
            case Chunk():
                self._stamp = max(self._stamp, record.message_end_time)
                self._checked &= record.uncompressed_crc != 0
                if self._required and record.uncompressed_crc == 0:
                    raise DamagedError(raw.at, "a chunk does not match its checksum")
                self._chunks.append(
                    ChunkPlace(raw.at, record.message_start_time, record.message_end_time)
                )
                self._chunk = raw
            case MessageIndex() if (
                record.channel_id not in self._topics and self._chunk is not None
            ):
                declared = (each for each in records_of(self._chunk) if isinstance(each, Channel))
                self._topics |= {channel.id: channel.topic for channel in declared}
            case Message():
                self._stamp = max(self._stamp, record.log_time)
                self._checked = False
                self._required = False
            case Channel():
                self._topics[record.id] = record.topic
            case Attachment():
                self._attachments[record.name] = raw.at
            case Metadata() if record.name == REPAIR:
                self._lost = record.metadata.get("lost", "")
            case DataEnd():
                self._data_ended = True
            case ChunkIndex() if self._indexed:
                self._stamp = max(self._stamp, record.message_end_time)
                place = ChunkPlace(
                    record.chunk_start_offset, record.message_start_time, record.message_end_time
                )
                self._chunks.append(place)
            case AttachmentIndex() if self._indexed:
                self._attachments[record.name] = record.offset
            case MetadataIndex() if self._indexed and record.name == REPAIR:
                metadata = decode(raw_record_at(self._stream, record.offset))
                self._lost = (
                    metadata.metadata.get("lost", "") if isinstance(metadata, Metadata) else ""
                )

    def _ended_within(self, at: int) -> Verdict:
        """Return the verdict on a file that ends within a record: it was cut off, or the record's length is wrong."""
        self._stream.seek(max(size_of(self._stream) - len(MAGIC), len(MAGIC)))
        if self._stream.read() == MAGIC or next_chunk(self._stream, at + 1) is not None:
            return self._made("damaged", str(DamagedError(at, "a record has a wrong length")))
        return self._made(
            "cut off",
            "its summary is missing" if self._data_ended else f"the file ends after {at} bytes",
        )

    def _made(self, state: str, why: str) -> Verdict:
        chunks = tuple(self._chunks) if self._required else None
        t = self._stamp / 1e9
        return Verdict(
            state,
            why,
            t,
            self._good,
            self._checked,
            self._lost,
            self._attachments,
            chunks,
            self._topics,
        )
