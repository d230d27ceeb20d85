"""Text of an exception for the operator."""

from __future__ import annotations


def sentence_of(error: BaseException) -> str:
    """Return the text of an exception, or its name if it has none; for Python's own exceptions, both."""
    name = type(error).__name__
    try:
        text = str(error)
    except BaseException as second:  # a defect in the exception's own text must not prevent a stop
        return f"{name}, which cannot be shown: {type(second).__name__}"
    if isinstance(error, MemoryError) and not text:
        return "MemoryError: there is no memory left"
    if not text or isinstance(error, (LookupError, SystemExit)):  # 'mesh', list index out of range, 0
        return f"{name}: {text}" if text else name
    return text
