"""The decorator of all compiled loops."""

from __future__ import annotations

from functools import partial

from numba import njit

kernel = partial(njit, cache=True, no_cfunc_wrapper=True)
"""`numba.njit`, kept between runs, without the wrapper for C, which nobody calls and which takes long to compile."""
