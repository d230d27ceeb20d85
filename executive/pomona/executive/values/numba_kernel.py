"""The decorator of all compiled loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, update_wrapper
from typing import Any

from pomona.executive.values.later import Later

numba: Any = Later("numba")


def kernel(**options: Any) -> Any:
    """Compile a function at its first call; the options are those of `numba.njit`."""
    return lambda function: CompiledLater(function, options)


class CompiledLater:
    """A loop that numba compiles at its first call, since most commands import many loops and call none.

    It is kept between runs, without the wrapper for C, which nobody calls and which takes long to compile. All
    attributes are those of numba's function, also the one by which numba finds it in another loop.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._function = function
        self._options = options
        update_wrapper(self, function)

    @cached_property
    def _compiled(self) -> Any:
        return numba.njit(cache=True, no_cfunc_wrapper=True, **self._options)(self._function)

    def __call__(self, *arguments: Any) -> Any:
        return self._compiled(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._compiled, name)
