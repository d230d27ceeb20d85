"""What an exception says, for people."""

from __future__ import annotations


def sentence_of(error: BaseException) -> str:
    """What an exception says, or else its name; of Python's own, which say little by themselves, both."""
    name = type(error).__name__
    try:
        text = str(error)
    except BaseException as second:  # whoever wrote it: what it says must not keep anything from being stopped
        return f"{name}, which cannot be shown: {type(second).__name__}"
    if isinstance(error, MemoryError) and not text:
        return "MemoryError: there is no memory left"
    if not text or isinstance(error, (LookupError, SystemExit)):  # 'mesh', list index out of range, 0
        return f"{name}: {text}" if text else name
    return text
