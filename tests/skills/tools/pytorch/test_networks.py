"""The finder's network: its output, and a trunk that was trained before."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from pomona.skills.perception.detection.errors import BadFrame, BadWeights
from pomona.tools.pytorch.networks import ConvNorm, DopeNetwork, FinderNetwork, dope_input
from pomona.tools.pytorch.weights import load_weights

pytestmark = pytest.mark.slow


def test_a_folded_norm_gives_the_same_as_convolution_and_norm() -> None:
    torch.manual_seed(0)
    layer = ConvNorm(4, 6, 3, 2)
    layer(torch.randn(8, 4, 12, 12))  # statistics of some pictures
    layer.eval()
    with torch.no_grad():
        layer.norm.weight.uniform_(0.5, 2.0)
        layer.norm.bias.uniform_(-1.0, 1.0)
    x = torch.randn(2, 4, 10, 14)
    assert torch.allclose(layer(x), layer.norm(layer.conv(x)), atol=1e-5)


def test_maps_have_a_quarter_of_the_sides_and_begin_cold() -> None:
    torch.manual_seed(0)
    maps = FinderNetwork().eval()(torch.rand(1, 3, 64, 96) - 0.5).detach()
    assert maps.shape == (1, 6, 16, 24)
    assert float(maps[:, 0].sigmoid().max()) < 0.1


@pytest.mark.slow
def test_a_trained_trunk_keeps_its_statistics_and_first_blocks() -> None:
    network = FinderNetwork()
    network.keep_trunk()
    network.train()
    before = {key: value.clone() for key, value in network.state_dict().items()}
    network(torch.rand(2, 3, 64, 64) - 0.5).square().mean().backward()  # type: ignore[no-untyped-call]
    after = network.state_dict()
    changed = {key for key in after if not torch.equal(before[key], after[key])}
    assert changed
    assert not any(key.startswith("trunk.") for key in changed)
    assert network.trunk.stem.conv.weight.grad is None
    assert network.trunk.blocks[5].project.conv.weight.grad is not None
    assert network.last.weight.grad is not None


@pytest.fixture(scope="module")
def network() -> DopeNetwork:
    torch.manual_seed(0)
    return DopeNetwork().eval()


def test_parameters_and_keys_are_those_of_published_checkpoints(network: DopeNetwork) -> None:
    assert sum(p.numel() for p in network.parameters()) == 50_267_350
    keys = set(network.state_dict())
    assert len(keys) == 184
    expected = {
        f"vgg.{i}.{p}"
        for i in (0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25)
        for p in ("weight", "bias")
    }
    for stage, layers in [
        (1, (0, 2, 4, 6, 8)),
        *[(k, (0, 2, 4, 6, 8, 10, 12)) for k in range(2, 7)],
    ]:
        for branch in (1, 2):
            expected |= {f"m{stage}_{branch}.{i}.{p}" for i in layers for p in ("weight", "bias")}
    assert keys == expected
    shapes = {k: tuple(v.shape) for k, v in network.state_dict().items()}
    assert shapes["vgg.23.weight"] == (256, 512, 3, 3)
    assert shapes["m1_2.6.weight"] == (512, 128, 1, 1)
    assert shapes["m1_1.8.weight"] == (16, 512, 1, 1)
    assert shapes["m4_2.0.weight"] == (128, 153, 7, 7)
    assert shapes["m6_2.12.weight"] == (9, 128, 1, 1)


def test_maps_have_a_cell_for_eight_pixels_and_one_entry_a_stage(network: DopeNetwork) -> None:
    with torch.inference_mode():
        beliefs, affinities = network(torch.zeros(1, 3, 64, 80))
    assert [tuple(b.shape) for b in beliefs] == [(1, 9, 8, 10)] * 6
    assert [tuple(a.shape) for a in affinities] == [(1, 16, 8, 10)] * 6


@pytest.mark.slow
def test_maps_equal_those_of_plain_functional_calls(network: DopeNetwork) -> None:
    """The first two stages, written out again from the published description."""
    tensors = network.state_dict()

    def chain(
        x: torch.Tensor, prefix: str, indices: tuple[int, ...], last_relu: bool = False
    ) -> torch.Tensor:
        for i in indices:
            weight = tensors[f"{prefix}.{i}.weight"]
            x = nn.functional.conv2d(
                x, weight, tensors[f"{prefix}.{i}.bias"], padding=weight.shape[2] // 2
            )
            if prefix == "vgg":
                x = torch.relu(x)
                if i in (2, 7, 16):
                    x = nn.functional.max_pool2d(x, 2)
            elif i != indices[-1]:
                x = torch.relu(x)
        return x

    picture = torch.randn(1, 3, 48, 48, generator=torch.Generator().manual_seed(1))
    with torch.inference_mode():
        features = chain(picture, "vgg", (0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25))
        belief, affinity = (
            chain(features, "m1_2", (0, 2, 4, 6, 8)),
            chain(features, "m1_1", (0, 2, 4, 6, 8)),
        )
        joined = torch.cat([belief, affinity, features], 1)
        second = chain(joined, "m2_2", (0, 2, 4, 6, 8, 10, 12))
        beliefs, affinities = network(picture)
    assert torch.allclose(beliefs[0], belief, atol=1e-5)
    assert torch.allclose(affinities[0], affinity, atol=1e-5)
    assert torch.allclose(beliefs[1], second, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("prefix", ["", "module."])
def test_checkpoints_load_with_and_without_prefix(
    network: DopeNetwork, tmp_path: Path, prefix: str
) -> None:
    path = tmp_path / "net.pth"
    torch.save({prefix + key: value for key, value in network.state_dict().items()}, path)
    loaded = load_weights(path)
    assert all(
        torch.equal(a, b)
        for a, b in zip(loaded.state_dict().values(), network.state_dict().values(), strict=True)
    )
    assert not loaded.training


@pytest.mark.slow
def test_wrong_keys_and_shapes_are_named(network: DopeNetwork, tmp_path: Path) -> None:
    path = tmp_path / "net.pth"
    tensors = dict(network.state_dict())
    removed = tensors.pop("vgg.0.bias")
    torch.save({**tensors, "vgg.1.bias": removed}, path)
    with pytest.raises(
        BadWeights, match=r"1 missing \(vgg.0.bias\), 1 not expected \(vgg.1.bias\)"
    ):
        load_weights(path)
    torch.save({**tensors, "vgg.0.bias": torch.zeros(3)}, path)
    with pytest.raises(BadWeights, match=r"vgg.0.bias has shape \(3,\), expected \(64,\)"):
        load_weights(path)


def test_files_that_are_no_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadWeights, match="no such file"):
        load_weights(tmp_path / "gone.pth")
    (tmp_path / "text.pth").write_text("no weights")
    with pytest.raises(BadWeights, match="cannot be read"):
        load_weights(tmp_path / "text.pth")
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(BadWeights, match="mapping"):
        load_weights(tmp_path / "list.pth")


def test_input_is_normalised_and_shrunk_to_400_rows() -> None:
    white = np.full((480, 640, 3), 255, np.uint8)
    tensor, factor = dope_input(white)
    assert tuple(tensor.shape) == (1, 3, 400, 533)
    assert np.isclose(factor, 400 / 480)
    assert torch.allclose(
        tensor[0, :, 0, 0],
        (1 - torch.tensor([0.485, 0.456, 0.406])) / torch.tensor([0.229, 0.224, 0.225]),
    )
    small, unchanged = dope_input(white[:320])
    assert (tuple(small.shape), unchanged) == ((1, 3, 320, 640), 1.0)


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((480, 640), np.uint8),
        np.zeros((480, 640, 3)),
        np.zeros((3, 480, 640), np.uint8),
        np.zeros((4, 4, 3), np.uint8),
        None,
    ],
    ids=["grey", "float", "channels first", "tiny", "none"],
)
def test_pictures_of_another_shape_or_type_are_refused(picture: object) -> None:
    with pytest.raises(BadFrame, match="uint8 RGB"):
        dope_input(picture)  # type: ignore[arg-type]
