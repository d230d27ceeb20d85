"""Graphs are judged from their bytes, which another writer makes here, and run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from pomona.skills.perception.detection import onnx_runtime
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.onnx_runtime import (
    INPUT,
    PLAIN,
    SIZED,
    BadGraph,
    judge_layers,
    judge_model,
    judge_network,
    onnx_network,
)


def varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first; all but the last have their highest bit set."""
    digits = [value & 127]
    while value := value >> 7:
        digits.append(value & 127)
    return bytes([*(digit | 128 for digit in digits[:-1]), digits[-1]])


def told(number: int, content: bytes | str) -> bytes:
    """A field of bytes."""
    content = content.encode() if isinstance(content, str) else content
    return varint(number << 3 | 2) + varint(len(content)) + content


def counted(number: int, value: int) -> bytes:
    return varint(number << 3) + varint(value)


def node(operator: str, inputs: str, outputs: str, domain: str = "", inner: bytes = b"") -> bytes:
    """A node between named results."""
    given = [told(1, name) for name in inputs.split()] + [told(2, name) for name in outputs.split()]
    own = told(7, domain) if domain else b""
    return b"".join([*given, told(3, "a name"), told(4, operator), inner, own])


def holding(*graphs: bytes, several: bool = False) -> bytes:
    """An attribute with graphs of its own."""
    return told(5, told(1, "body") + b"".join(told(11 if several else 6, g) for g in graphs))


def graph(*nodes: bytes) -> bytes:
    return b"".join(told(1, each) for each in nodes)


def model(*nodes: bytes) -> bytes:
    return counted(1, 9) + told(7, graph(*nodes))


def words(content: bytes, judge=lambda content: judge_layers(content, "picture")) -> str:  # type: ignore[no-untyped-def]
    """Why a graph is refused; empty if it is not."""
    try:
        judge(content)
    except BadGraph as error:
        return str(error)
    return ""


def test_layers_from_the_picture_to_the_result_are_taken() -> None:
    assert words(model(node("Relu", "picture", "a"), node("Add", "a picture", "maps"))) == ""
    assert words(model(node("Relu", "picture", "maps", "ai.onnx"))) == ""
    assert words(b"") == ""


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (node("Gru", "picture", "a"), "has the operator 'Gru', which"),
        (node("Relu", "picture", "a", "own"), "has the operator 'own.Relu', which"),
        (node("X" * 70, "picture", "a"), f"has the operator '{'X' * 60}', which"),
        (node("Relu", "picture", "a", inner=holding(b"")), "has the operator 'Relu', which"),
        (node("Relu", "b", "picture"), "lists a node before one whose result it takes"),
    ],
)
def test_other_operators_and_another_order_are_refused_wherever_they_stand(
    bad: bytes, message: str
) -> None:
    good = node("Relu", "picture", "b")
    for nodes in ((good, bad), (good, bad, good)):
        assert words(model(*nodes)).startswith(message)


@pytest.mark.parametrize("operator", sorted(SIZED))
def test_a_size_may_follow_from_the_shape_of_the_picture_and_not_from_its_values(
    operator: str,
) -> None:
    for place in range(4):
        inputs = ["k0", "k1", "k2", "k3"][: max(SIZED[operator]) + 1]
        if place >= len(inputs):
            continue
        inputs[place] = "size"
        sized = node(operator, " ".join(inputs), "maps")
        mean, shape = node("ReduceMean", "picture", "bright"), node("Shape", "picture", "size")
        cast = node("Cast", "bright", "size")
        refused = words(model(mean, cast, sized))
        expected = f"computes a size of its operator '{operator}' from the picture"
        assert refused.startswith(expected) if place in SIZED[operator] else refused == ""
        assert words(model(shape, sized)) == ""
        shape_of_mean = node("Shape", "bright", "size")
        assert words(model(mean, shape_of_mean, sized)) == ""
    assert operator in PLAIN


@pytest.mark.parametrize("operator", ["Loop", "Scan", "SequenceMap"])
@pytest.mark.parametrize("several", [False, True])
def test_a_loop_is_found_at_any_depth_and_nothing_deeper_is_read(
    operator: str, several: bool
) -> None:
    inner = node(operator, "x", "y")
    for depth in range(6):
        found = words(model(inner), judge_model)
        if depth == 5:
            assert found == "has graphs in its nodes, more than 4 deep"
        else:
            assert found.startswith(f"has the operator '{operator}': a detector has no loops")
        plain = node("Relu", "x", "z")
        held = (graph(plain), graph(inner)) if several else (graph(plain, inner),)
        inner = node("If", "x", "y", inner=holding(*held, several=several))
    assert words(model(node("Gru", "a", "b", "own")), judge_model) == ""


def test_functions_and_too_many_nodes_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_runtime, "MOST_NODES", 5)
    nested = node("If", "x", "y", inner=holding(graph(*[node("Relu", "x", "y")] * 2)))
    for judge in (judge_model,):
        assert words(model(*[node("Relu", "picture", "a")] * 5), judge) == ""
        assert words(model(*[node("Relu", "picture", "a")] * 6), judge).startswith(
            "has more than 5"
        )
        assert words(model(nested, *[node("Relu", "x", "y")] * 2), judge) == ""
        assert words(model(nested, *[node("Relu", "x", "y")] * 3), judge).startswith("has more")
        assert words(told(25, "f") + model(), judge).startswith("defines functions of its own")


def test_fields_of_all_kinds_are_passed_over_by_their_length() -> None:
    loop = told(7, graph(node("Loop", "a", "b")))
    others = (
        counted(2, 300), counted(2, 2**63), varint(2 << 3 | 1) + bytes(8), varint(2 << 3 | 5) + bytes(4),
        told(2, "x" * 200), told(2, b""), counted(7, 5), told(300, "far"),
    )  # fmt: skip
    for other in others:
        assert words(other + loop, judge_model).startswith("has the operator 'Loop'")
        assert words(other, judge_model) == ""
        if len(other) > 1:
            assert words(loop[:0] + other[:-1], judge_model).endswith("it is damaged")


@pytest.mark.parametrize(
    "content",
    [
        varint(2 << 3 | 3), varint(2 << 3 | 4), varint(2 << 3 | 6), varint(2 << 3 | 7), b"\x80",
        b"\x10" + b"\x80" * 10 + b"\x01", told(7, told(1, b"\x0a\x05ab")), told(7, b"\x80"),
    ],
)  # fmt: skip
def test_damaged_bytes_are_refused(content: bytes) -> None:
    assert words(content, judge_model) == "cannot be read as ONNX: it is damaged"
    assert words(content) == "cannot be read as ONNX: it is damaged"


def test_a_number_has_ten_bytes_at_most() -> None:
    assert words(b"\x10" + b"\x80" * 9 + b"\x01", judge_model) == ""


def test_a_bad_member_of_a_file_is_named_with_the_file() -> None:
    judge_network(model(node("Relu", "picture", "maps")), "a.weights", "finder.onnx")
    with pytest.raises(BadWeights, match=r"a\.weights: finder\.onnx in it has the operator 'Gru'"):
        judge_network(model(node("Gru", "picture", "maps")), "a.weights", "finder.onnx")


def runnable(*inputs: str) -> bytes:
    """A whole model: maps = 0 where its first input is negative, else that input."""

    def tensor(name: str) -> bytes:
        sides = b"".join(told(1, told(2, side)) for side in ("n", "c", "h", "w"))
        return told(1, name) + told(2, told(1, counted(1, 1) + told(2, sides)))

    given = b"".join(told(11, tensor(name)) for name in inputs)
    layers = (
        graph(node("Relu", inputs[0], "maps")) + told(2, "g") + given + told(12, tensor("maps"))
    )
    return counted(1, 9) + told(7, layers) + told(8, told(1, "") + counted(2, 18))


def test_a_network_runs_on_its_picture() -> None:
    run = onnx_network(runnable(INPUT), "a.weights", "finder.onnx")
    picture = np.linspace(-1.0, 1.0, 24, dtype=np.float32).reshape(1, 2, 3, 4)
    (maps,) = run(picture)
    np.testing.assert_array_equal(maps, np.maximum(picture, 0.0))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (runnable(INPUT, "mask"), r"has the inputs \['picture', 'mask'\], expected \['picture'\]"),
        (runnable("drawing"), r"has the inputs \['drawing'\], expected \['picture'\]"),
        (b"no model", "cannot be read as ONNX: "),
    ],
)
def test_a_network_of_anything_but_one_picture_is_refused(content: bytes, message: str) -> None:
    with pytest.raises(BadWeights, match=r"a\.weights: finder\.onnx in it " + message):
        onnx_network(content, "a.weights", "finder.onnx")


def test_a_session_uses_one_thread_and_the_processor() -> None:
    session = onnx_runtime.open_session(runnable(INPUT))
    settings = session.get_session_options()
    assert (settings.intra_op_num_threads, settings.inter_op_num_threads) == (1, 1)
    assert settings.log_severity_level == 4
    assert session.get_providers() == ["CPUExecutionProvider"]


def parts() -> Iterator[bytes]:
    yield from (varint(number) for number in (0, 1, 127, 128, 300, 2**31, 2**62))


def test_numbers_of_any_length_are_read() -> None:
    for each in parts():
        value, at = onnx_runtime._varint(memoryview(each + b"\xff"), 0)
        assert varint(value) == each
        assert at == len(each)
