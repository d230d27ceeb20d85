"""The compact detector's networks to and from its weights file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.weights_file import FusedScore, read_weights, write_weights
from pomona.skills.perception.fruit import load_fruit
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import load_compact, save_compact

pytestmark = pytest.mark.slow

SMALL = (8, 8, 8, 8, 8)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FinderNetwork, CloseLookNetwork]:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("saved") / "apple.weights"
    finder, close_look = FinderNetwork().eval(), CloseLookNetwork((16, 24, 32, 8, 20)).eval()
    score = FusedScore(np.ones((2, 5)), np.array([1.0, -1.0, 0.5]))
    save_compact(path, finder, close_look, {"frames": "12"}, score)
    return path, finder, close_look


@pytest.mark.slow
def test_saved_networks_load_again_as_wide_as_they_were(saved) -> None:
    path, finder, close_look = saved
    assert path.stat().st_size < 10e6
    stored = read_weights(path)
    assert stored.about == {"frames": "12"}
    assert isinstance(stored.scores, FusedScore)
    assert stored.scores.of(np.eye(4)) == pytest.approx(
        FusedScore(np.ones((2, 5)), np.array([1.0, -1.0, 0.5])).of(np.eye(4))
    )
    again, look_again = load_compact(path)
    assert look_again.widths == (16, 24, 32, 8, 20)
    picture, crop = torch.rand(1, 3, 64, 96) - 0.5, torch.rand(2, 3, 96, 96) - 0.5
    with torch.inference_mode():
        assert torch.allclose(again(picture), finder(picture), atol=2e-2)
        assert torch.allclose(look_again(crop), close_look(crop), atol=1e-2)


def test_the_oldest_shipped_weights_are_refused_with_others_that_can_be_learnt_on() -> None:
    weights = load_fruit("apple").weights
    assert weights is not None
    words = "has a finder that cannot be learnt on; that of apple_photographs.weights can"
    with pytest.raises(BadWeights, match=words):
        load_compact(weights)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.weights"
    with pytest.raises(BadWeights, match="no such file"):
        load_compact(path)
    torch.save({"vgg.0.weight": torch.zeros(1)}, path)
    with pytest.raises(BadWeights, match="is not a 'pomona compact detector 3' file"):
        load_compact(path)
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(BadWeights, match="cannot be read"):
        load_compact(path)


@pytest.mark.slow
def test_tensors_that_are_missing_and_widths_that_cannot_be_used_are_named(saved, tmp_path) -> None:
    stored, path = read_weights(saved[0]), tmp_path / "changed.weights"
    finder = onnx.load_model_from_string(stored.finder)
    tensors = finder.graph.initializer
    (first,) = (one for one in tensors if one.name.startswith("last.bias"))
    tensors.remove(first)
    write_weights(path, replace(stored, finder=finder.SerializeToString()))
    with pytest.raises(BadWeights, match=r"1 missing \(last\.bias\)"):
        load_compact(path)
    for widths in ([8, 12], [8, 12, 16, -1, 8], [8, 12, 16, 10**9, 8], ["a", 1, 1, 1, 1]):
        write_weights(path, replace(stored, widths={"close_look": widths}))
        with pytest.raises(BadWeights, match="has no usable widths of its networks"):
            load_compact(path)


@pytest.mark.slow
def test_values_beyond_half_precision_are_not_written(tmp_path: Path) -> None:
    large = CloseLookNetwork(SMALL)
    with torch.no_grad():
        large.trunk[2].norm.bias[0] = 1e6
    words = r"trunk\.2\.norm\.bias holds values that are not finite in half precision"
    with pytest.raises(BadWeights, match=words):
        save_compact(tmp_path / "large.weights", FinderNetwork(), large)
    assert not (tmp_path / "large.weights").exists()
