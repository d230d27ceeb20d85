"""Scripts of URScript run cycle by cycle, with URScript's own rules for blocks, threads and variables."""

from __future__ import annotations

from typing import Any

import pytest

from pomona.devices.laboratory_emulators.urscript import compile_script, to_python


def run(text: str, cycles: int) -> list[Any]:
    told: list[Any] = []
    threads: list[Any] = []

    def sync():  # type: ignore[no-untyped-def]
        yield

    functions = {
        "tell": told.append,
        "sync": sync,
        "run": lambda f: threads.append(f()),
        "pose": tuple,
    }
    _, space = compile_script(text, functions)
    threads.append(space["__main"]())
    for _ in range(cycles):
        for thread in list(threads):
            next(thread, None)
    return told


def test_a_loop_makes_one_turn_a_cycle() -> None:
    assert run(
        "def p():\n n = 0\n while n < 5:\n  n = n + 1\n  tell(n)\n  sync()\n end\nend\n", 3
    ) == [1, 2, 3]


def test_a_function_assigns_a_variable_of_the_program_and_keeps_its_own() -> None:
    text = """
def p():
  global total = 1 # of the program
  def add(n):
    total = total + n
    other = total * 10
    return other
  end
  tell(add(4))
  if total == 5:
    tell("five # no comment")
  elif True:
    tell("other")
  else:
    tell("none")
  end
end
"""
    assert run(text, 1) == [50, "five # no comment"]


def test_threads_run_beside_the_program_and_calls_that_take_time_wait() -> None:
    text = """
def p():
  def pause():
    sync()
    sync()
  end
  thread beside():
    tell("thread")
    pause()
    tell("thread again")
  end
  run beside()
  pause()
  tell(p[1, 2][1])
end
"""
    assert run(text, 4) == ["thread", 2, "thread again"]


def test_a_block_without_its_end_is_no_script() -> None:
    with pytest.raises(SyntaxError, match="1 blocks lack their end"):
        to_python("def p():\n  if True:\n  end\n")
