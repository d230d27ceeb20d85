"""The compact detector's networks to and from its weights file, and files of earlier versions."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from pomona.executive.values.installation import install_extra
from pomona.skills.perception.detection.close_look import CLOSE_LOOK_OUTPUTS
from pomona.skills.perception.detection.compact_detector import CompactDetector, read_stored
from pomona.skills.perception.detection.errors import BadWeights, MissingPackage
from pomona.skills.perception.detection.weights_file import FusedScore, PowerScore, ScoreMap
from pomona.tools.pytorch.networks import BeliefFinder, CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import TORCH_FORMAT, load_compact, save_compact


def save_with_torch(
    path: Path, finder: BeliefFinder, close_look: CloseLookNetwork, **more: object
) -> dict[str, dict[str, torch.Tensor]]:
    """Write a file as earlier versions did, and return its content."""
    content: dict[str, object] = {
        "format": TORCH_FORMAT,
        "about": {"fruit": "apple"},
        "widths": {},
        **more,
    }
    for name, network in (("finder", finder), ("close_look", close_look)):
        content["widths"][name] = list(network.widths)
        content[name] = {
            key: value.half()
            for key, value in network.state_dict().items()
            if not key.endswith("num_batches_tracked")
        }
    torch.save(content, path)
    return content


@pytest.mark.slow
def test_saved_networks_load_again_with_their_story(tmp_path: Path) -> None:
    torch.manual_seed(0)
    finder, close_look = FinderNetwork().eval(), CloseLookNetwork().eval()
    path = tmp_path / "apple.weights"
    score = FusedScore(np.ones((2, 5)), np.array([1.0, -1.0, 0.5]))
    save_compact(path, finder, close_look, {"frames": "12"}, score)
    assert path.stat().st_size < 10e6
    read = read_stored(path).scores
    assert isinstance(read, FusedScore)
    assert np.array_equal(read.of(np.eye(4)), score.of(np.eye(4)))
    again, look_again, about = load_compact(path)
    assert about == {"frames": "12"}
    picture, crop = torch.rand(1, 3, 64, 96) - 0.5, torch.rand(2, 3, 96, 96) - 0.5
    with torch.inference_mode():
        assert isinstance(again, FinderNetwork)
        assert torch.allclose(again(picture), finder(picture), atol=2e-2)
        assert torch.allclose(look_again(crop), close_look(crop), atol=1e-2)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.weights"
    with pytest.raises(BadWeights, match="no such file"):
        load_compact(path)
    torch.save({"vgg.0.weight": torch.zeros(1)}, path)
    with pytest.raises(BadWeights, match="is not a 'pomona compact detector 2'"):
        load_compact(path)
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(BadWeights, match="cannot be read"):
        load_compact(path)


def test_tensors_that_do_not_fit_or_are_not_finite_are_named(tmp_path: Path) -> None:
    path = tmp_path / "apple.pt"
    content = save_with_torch(path, BeliefFinder(), CloseLookNetwork())
    content["finder"]["at_4.second.weight"][0] = float("nan")
    torch.save(content, path)
    with pytest.raises(BadWeights, match=r"at_4\.second\.weight holds values that are not finite"):
        load_compact(path)
    del content["finder"]["at_4.second.weight"]
    torch.save(content, path)
    with pytest.raises(BadWeights, match=r"1 missing \(at_4\.second\.weight\)"):
        load_compact(path)
    large = BeliefFinder((8, 8, 8, 8))
    with torch.no_grad():
        large.at_4.norm.bias[0] = 1e6
    with pytest.raises(
        BadWeights, match=r"at_4\.norm\.bias holds values that are not finite in half precision"
    ):
        save_compact(tmp_path / "large.weights", large, CloseLookNetwork((8, 8, 8, 8, 8)))
    assert not (tmp_path / "large.weights").exists()


@pytest.mark.slow
def test_networks_of_other_widths_load_as_wide_as_they_were_saved(tmp_path: Path) -> None:
    networks = BeliefFinder((8, 12, 16, 24)), CloseLookNetwork((16, 24, 32, 8, 20))
    save_compact(tmp_path / "small.weights", *networks)
    content = save_with_torch(tmp_path / "small.pt", *networks)
    for name in ("small.weights", "small.pt"):
        finder, close_look, _ = load_compact(tmp_path / name)
        assert isinstance(finder, BeliefFinder)
        assert (finder.widths, close_look.widths) == ((8, 12, 16, 24), (16, 24, 32, 8, 20))
    for widths in ([8, 12], [8, 12, 16, -1], [8, 12, 16, 10**9], None, ["a", 1, 1, 1]):
        content["widths"]["finder"] = widths
        torch.save(content, tmp_path / "small.pt")
        with pytest.raises(BadWeights, match="has no usable widths of its networks"):
            load_compact(tmp_path / "small.pt")


@pytest.mark.slow
def test_a_file_of_an_earlier_version_finds_the_same_and_keeps_its_scores(tmp_path: Path) -> None:
    torch.manual_seed(0)
    networks = BeliefFinder((8, 8, 8, 8)), CloseLookNetwork((8, 8, 8, 8, 8))
    save_with_torch(tmp_path / "old.pt", *networks, scores=[0.7, -0.2])
    save_compact(
        tmp_path / "new.weights", *networks, {"fruit": "apple"}, PowerScore(ScoreMap(0.7, -0.2))
    )
    assert read_stored(tmp_path / "old.pt") == read_stored(tmp_path / "new.weights")
    picture = np.random.default_rng(0).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    old, new = (CompactDetector.load(tmp_path / name) for name in ("old.pt", "new.weights"))
    assert np.array_equal(old.maps(picture)[0], new.maps(picture)[0])
    for wrong in ([-1.0, 0.0], [float("nan"), 0.0], [1.0], "steep"):
        save_with_torch(tmp_path / "wrong.pt", *networks, scores=wrong)
        with pytest.raises(BadWeights, match="scores"):
            read_stored(tmp_path / "wrong.pt")


@pytest.mark.slow
def test_a_file_of_an_earlier_version_without_pytorch_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_with_torch(
        tmp_path / "old.pt", BeliefFinder((8, 8, 8, 8)), CloseLookNetwork((8, 8, 8, 8, 8))
    )
    monkeypatch.setitem(sys.modules, "pomona.tools.pytorch.weights", None)
    with pytest.raises(
        MissingPackage, match=r"torch reads \S*old\.pt.*" + re.escape(install_extra("torch"))
    ):
        CompactDetector.load(tmp_path / "old.pt")


def test_a_close_look_of_an_earlier_version_loses_its_box(tmp_path: Path) -> None:
    finder, close_look = BeliefFinder((8, 8, 8, 8)), CloseLookNetwork((8, 8, 8, 4, 8))
    content = save_with_torch(tmp_path / "old.pt", finder, close_look)
    last = content["close_look"]
    for key in ("head.3.weight", "head.3.bias"):
        last[key] = torch.cat([last[key], torch.ones_like(last[key][:4])])
    torch.save(content, tmp_path / "old.pt")
    _, loaded, _ = load_compact(tmp_path / "old.pt")
    assert loaded(torch.zeros(1, 3, 96, 96)).shape == (1, CLOSE_LOOK_OUTPUTS)
    assert torch.equal(
        loaded.state_dict()["head.3.bias"], last["head.3.bias"][:CLOSE_LOOK_OUTPUTS].float()
    )
