"""The finder's network: its output, and a trunk that was trained before."""

import torch

from pomona.skills.perception.detection.finder_network import ConvNorm, FinderNetwork


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
