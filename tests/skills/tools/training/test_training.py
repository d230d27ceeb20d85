"""Training: resumes exactly, refuses inconsistent parts, and learns."""

import copy
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from pomona.skills.perception.detection.close_look import HEAT, QUALITY, REACHES
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.training import optimiser, targets, train
from pomona.tools.training.annotations import BadTraining
from pomona.tools.training.dataset import render_dataset
from pomona.tools.training.finder_samples import FinderBatches
from pomona.tools.training.loop import Progress, Schedule
from pomona.tools.training.losses import close_look_loss, finder_loss
from pomona.tools.training.optimiser import Optimiser
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.places import find_places, load_places, save_places
from pomona.tools.training.samples import CloseLookBatches, FrameFolder
from pomona.tools.training.targets import finder_targets
from pomona.tools.training.torch_engine import torch_detector
from pomona.tools.training.train import Part, TrainingRun, train_part

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    render_dataset(folder, 4, seed=77, options=SceneOptions(kinds=(1, 0, 0, 0)), workers=1)
    return folder


def run(frames: Path, out: Path, part: Part, steps: int, **changes: float) -> TrainingRun:
    schedule = Schedule(steps, validate_every=2, warm_up=2, **changes)
    return TrainingRun(part, ((frames, 4),), out, schedule, workers=0)


def fresh(part: Part) -> FinderNetwork | CloseLookNetwork:
    torch.manual_seed(0)
    return FinderNetwork() if part == "finder" else CloseLookNetwork((8, 8, 8, 4, 8))


@pytest.mark.parametrize("part", ["finder", "close_look"])
def test_an_interrupted_run_ends_with_the_same_weights(
    frames: Path, tmp_path: Path, part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.set_num_threads(1)
    whole = train_part(run(frames, tmp_path / "whole", part, 4), fresh(part))

    class Cut(Exception):
        pass

    batches = FinderBatches if part == "finder" else CloseLookBatches
    original = batches.__getitem__

    def until_three(self: object, step: int) -> tuple[torch.Tensor, ...]:
        if step == 3:
            raise Cut
        return original(self, step)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(batches, "__getitem__", until_three)
        with pytest.raises(Cut):
            train_part(run(frames, tmp_path / "cut", part, 4), fresh(part))
    resumed = train_part(run(frames, tmp_path / "cut", part, 4), fresh(part))
    for a, b in zip(whole.state_dict().values(), resumed.state_dict().values(), strict=True):
        assert torch.equal(a, b)


def test_muon_moves_every_direction_of_a_kernel_alike_and_adam_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Conv2d(8, 16, 3), torch.nn.Linear(16, 4))
    kernel, answer = network[0].weight, network[1].weight
    before, row = kernel.detach().clone(), answer.detach().clone()
    for parameter in network.parameters():
        # A gradient that is nearly one direction alone.
        parameter.grad = torch.ones_like(parameter) + 0.1 * torch.randn_like(parameter)
    monkeypatch.setattr(optimiser, "DECAY", 0.0)
    Optimiser(network).step(0.01)
    moved = torch.linalg.svdvals((before - kernel.detach()).flatten(1)) / (0.01 * 0.2 * 72**0.5)
    assert 0.5 < float(moved.min()) <= float(moved.max()) < 1.5
    assert torch.allclose(row - answer.detach(), torch.full_like(row, 0.01), rtol=0.01)


def test_an_optimiser_goes_on_from_its_state() -> None:
    torch.manual_seed(0)
    network = CloseLookNetwork((8, 8, 8, 4, 8))
    steps = [[torch.randn_like(p) for p in network.parameters()] for _ in range(3)]

    def move(by: Optimiser, target: CloseLookNetwork, gradients: list[torch.Tensor]) -> None:
        for parameter, gradient in zip(target.parameters(), gradients, strict=True):
            parameter.grad = gradient
        by.step(1e-2)

    first = Optimiser(network)
    move(first, network, steps[0])
    twin = CloseLookNetwork((8, 8, 8, 4, 8))
    twin.load_state_dict(network.state_dict())
    second = Optimiser(twin)
    second.restore(copy.deepcopy(first.state()))
    for gradients in steps[1:]:
        move(first, network, gradients)
        move(second, twin, gradients)
    for a, b in zip(network.parameters(), twin.parameters(), strict=True):
        assert torch.equal(a, b)


def test_a_checkpoint_of_another_schedule_is_refused(frames: Path, tmp_path: Path) -> None:
    train_part(run(frames, tmp_path, "close_look", 2), fresh("close_look"))
    with pytest.raises(BadTraining, match="another schedule \\(steps, rate\\)"):
        train_part(run(frames, tmp_path, "close_look", 3, rate=1e-4), fresh("close_look"))


def test_a_late_fall_may_be_put_off_while_the_rate_is_still_high(
    frames: Path, tmp_path: Path
) -> None:
    short = Schedule(100, 1e-3, "late", warm_up=5)
    assert [short.rate_at(k) for k in (0, 4, 5, 59)] == [2e-4, 1e-3, 1e-3, 1e-3]
    assert np.allclose([short.rate_at(k) for k in (60, 80, 99)], [1e-3, 5e-4, 2.5e-5])

    def late(steps: int) -> TrainingRun:
        changed = dataclasses.replace(
            run(frames, tmp_path, "close_look", 1).schedule, steps=steps, fall="late"
        )
        return dataclasses.replace(run(frames, tmp_path, "close_look", 1), schedule=changed)

    train_part(late(4), fresh("close_look"))
    with pytest.raises(BadTraining, match="another schedule \\(steps\\)"):
        train_part(late(8), fresh("close_look"))  # the rate had begun to fall
    checkpoint = tmp_path / "close_look.checkpoint.pt"
    state = torch.load(checkpoint, weights_only=True)
    torch.save(state | {"step": 2}, checkpoint)
    said: list[Progress] = []
    train_part(late(8), fresh("close_look"), said.append)
    assert said[-1].step == 8


@pytest.mark.parametrize("part", ["finder", "close_look"])
def test_progress_shows_loss_rate_and_held_out_loss(
    frames: Path, tmp_path: Path, part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train, "HELD_OUT", {"finder": (1, 1), "close_look": (8, 1)})
    said: list[Progress] = []
    plan = TrainingRun(
        part, ((frames, 2),), tmp_path, Schedule(2, validate_every=2), frames, workers=0
    )
    train_part(plan, fresh(part), said.append)
    assert said[-1].step == said[-1].steps == 2
    assert said[-1].held_out is not None
    assert np.isfinite(said[-1].held_out)


def test_no_frames_is_an_error_in_words(tmp_path: Path) -> None:
    with pytest.raises(BadTraining, match="no annotated frames"):
        FrameFolder([tmp_path])


def test_batches_depend_on_seed_and_step_alone(frames: Path) -> None:
    folder = FrameFolder([frames])
    first, again, other = (CloseLookBatches(folder, 6, seed, 9)[5] for seed in (3, 3, 4))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first[0], other[0])


def test_close_looks_hold_the_fruit_they_are_labelled_with(frames: Path) -> None:
    pictures, target, kind, visibility = CloseLookBatches(
        FrameFolder([frames]), 40, 0, 1, augment=False
    )[0]
    fruit = kind > 0.5
    assert 8 <= int(fruit.sum()) < 40
    assert pictures.shape == (40, 96, 96, 3)
    assert float(target[fruit][:, :2].abs().max()) < 0.4
    assert float(target[fruit][:, 2].abs().max()) < 0.8
    assert torch.allclose(
        target[fruit][:, 3:6].norm(dim=1), torch.ones(int(fruit.sum())), atol=1e-4
    )
    assert float(visibility[~fruit].abs().max()) == 0.0


def test_places_are_kept_and_false_finds_are_taught_as_no_fruit(
    frames: Path, tmp_path: Path
) -> None:
    folder = FrameFolder([frames])
    torch.manual_seed(0)
    found = find_places(torch_detector(FinderNetwork(), CloseLookNetwork()), folder)
    assert set(found) == {folder.name(k) for k in range(4)}
    fruit = folder.annotation(0).objects[0]
    deceiving = {
        folder.name(k): np.array([[*np.array([600.0, 20.0]), 30.0, 0.9]] * 30) for k in range(4)
    }
    deceiving[folder.name(0)] = np.array([[*fruit.keypoints[8], 50.0, 0.9]])
    save_places(tmp_path / "places.npz", deceiving)
    again = load_places(tmp_path / "places.npz")
    assert again.keys() == deceiving.keys()
    assert all(np.array_equal(again[name], rows) for name, rows in deceiving.items())
    without = CloseLookBatches(folder, 200, 0, 1)[0][2]
    taught = CloseLookBatches(folder, 200, 0, 1, places=again)[0][2]
    assert float(taught.mean()) < 0.7 * float(without.mean())


def test_only_the_share_that_is_asked_for_is_turned_anyhow(frames: Path) -> None:
    folder, rng = FrameFolder([frames]), np.random.default_rng(5)
    for turned, low, high in ((0.0, 0.0, 0.0), (0.2, 0.09, 0.20), (1.0, 0.65, 0.79)):
        batches = CloseLookBatches(folder, 4, 0, 1, turned=turned)
        rolls = np.abs([batches._roll(rng) for _ in range(600)])
        assert rolls.max() <= np.pi
        assert low <= (rolls > np.deg2rad(50.0)).mean() <= high
    assert CloseLookBatches(folder, 4, 0, 1, augment=False, turned=1.0)._roll(rng) == 0.0


def test_a_turned_look_keeps_its_label_true(frames: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = FrameFolder([frames])
    upright = CloseLookBatches(folder, 30, 0, 1, augment=False)
    straight, target, kind, *_ = upright[0]
    monkeypatch.setattr(upright, "_roll", lambda rng: 0.5 * np.pi)
    turned, turned_target, _, _ = upright[0]
    fruit = kind > 0.5
    # A quarter turn of the camera: what pointed along y of the look points along x then.
    assert torch.allclose(turned_target[fruit, 0], target[fruit, 1], atol=1e-3)
    assert torch.allclose(turned_target[fruit, 2], target[fruit, 2], atol=1e-3)
    assert torch.allclose(turned_target[fruit, 3], target[fruit, 4], atol=1e-3)
    assert torch.allclose(turned_target[fruit, 4], -target[fruit, 3], atol=1e-3)
    same = np.rot90(straight.numpy(), 1, (1, 2)).astype(float) - turned.numpy()
    assert np.abs(same).mean() < 2.0


def test_the_finders_loss_is_least_at_the_target_and_counts_no_doubtful_cell() -> None:
    boxes = np.array([[4.0, 6.0, 10.0, 8.0], [20.0, 12.0, 6.0, 6.0]])
    wanted = finder_targets(boxes, np.array([True, False]), 24, 32)
    truth = torch.from_numpy(wanted)[None]
    maps = torch.zeros(1, 6, 24, 32)
    maps[:, HEAT] = torch.where(truth[:, targets.PEAK] > 0, 9.0, -9.0)
    maps[:, REACHES] = torch.log(truth[:, targets.REACHES].clamp(min=0.1))
    maps[:, QUALITY] = 9.0
    least = float(finder_loss(maps, truth))
    assert least < 0.02

    def changed(row: int | slice, by: float, rows: slice, columns: slice) -> float:
        worse = maps.clone()
        worse[:, row, rows, columns] += by
        return float(finder_loss(worse, truth))

    everywhere = slice(None), slice(None)
    assert changed(HEAT, 12.0, slice(0, 3), slice(0, 3)) > least + 0.1
    assert changed(REACHES, 0.3, *everywhere) > least + 0.1
    assert changed(QUALITY, -4.0, *everywhere) > least + 0.001
    inside = slice(13, 17), slice(21, 25)  # of the box that is not taught
    assert changed(HEAT, 12.0, *inside) == pytest.approx(least)
    assert changed(REACHES, 0.3, *inside) == pytest.approx(least)


def test_the_quality_learns_the_overlap_that_the_box_has() -> None:
    truth = torch.from_numpy(
        finder_targets(np.array([[8.0, 8.0, 8.0, 8.0]]), np.array([True]), 24, 24)
    )[None]
    maps = torch.zeros(1, 6, 24, 24)
    # A box of twice the area around the target's own: an IoU of one half everywhere.
    maps[:, REACHES] = torch.log(truth[:, targets.REACHES].clamp(min=0.1))
    maps[:, REACHES.start] = torch.log(truth[:, targets.REACHES.start] + 8.0)
    costs = []
    for ratio in (0.3, 0.5, 0.7):
        maps[:, QUALITY] = float(np.log(ratio / (1.0 - ratio)))
        costs.append(float(finder_loss(maps, truth)))
    assert min(costs) == costs[1]


def test_losses_of_looks_are_least_at_the_target() -> None:
    torch.manual_seed(0)
    target, kind, seen = (
        torch.rand(3, 6),
        torch.tensor([1.0, 1.0, 0.0]),
        torch.tensor([1.0, 0.5, 0.0]),
    )
    output = torch.zeros(3, 11)
    output[:, :6] = target
    base = close_look_loss(output, target, kind, seen)
    for columns in (slice(0, 2), slice(2, 3), slice(3, 6)):
        worse, elsewhere = output.clone(), output.clone()
        worse[:2, columns] += 0.1
        elsewhere[2, columns] += 0.1
        assert close_look_loss(worse, target, kind, seen) > base
        assert torch.isclose(close_look_loss(elsewhere, target, kind, seen), base)
