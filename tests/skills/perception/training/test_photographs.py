"""What boxes teach and what they leave open: against discs whose centre and radius are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pomona.skills.perception.detection.close_look import MARGIN, REFERENCE_LENGTH, SIZE_OF_BOX, look_at
from pomona.skills.perception.detection.compact_network import FinderNetwork
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.skills.perception.detection.outputs import BOX, KIND, SEEN
from pomona.skills.perception.training.losses import DOUBTED, close_look_loss, finder_loss
from pomona.skills.perception.training.photo_folder import read_empty, read_photographs
from pomona.skills.perception.training.photo_samples import Mixed, PhotoCloseLookBatches, PhotoFinderBatches
from pomona.skills.perception.training.photographs import (
    Labels,
    PhotoSet,
    camera_of,
    fruit_scale,
    labels_of,
    most_visible,
)
from pomona.skills.perception.training.targets import box_targets
from tests.skills.perception.training.photo_folders import tables


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> PhotoSet:
    return read_photographs(tables(tmp_path_factory.mktemp("photographs") / "set"))


def labels(*boxes: tuple[float, float, float, float], crowd: bool = False) -> Labels:
    return labels_of(np.array(boxes, np.float64), np.full(len(boxes), crowd), 640, 480)


def test_a_fruit_that_the_border_cuts_is_completed_from_its_uncut_side() -> None:
    radius = 40.0
    for centre in ((10.0, 200.0), (625.0, 200.0), (300.0, 15.0), (300.0, 470.0)):
        low = np.clip(np.array(centre) - radius, 0.0, (640.0, 480.0))
        high = np.clip(np.array(centre) + radius, 0.0, (640.0, 480.0))
        label = labels((*low, *(high - low)))
        assert label.centres[0] == pytest.approx(np.array(centre) - 0.5)
        assert label.sizes[0] == pytest.approx(SIZE_OF_BOX * 2.0 * radius)
        assert label.counted[0]


def test_corners_narrow_boxes_and_whole_fruit_tell_no_more_than_they_show() -> None:
    corner, narrow, whole = labels((0, 0, 50, 45)), labels((100, 100, 60, 40)), labels((100, 100, 60, 55))
    assert corner.counted.tolist() == narrow.counted.tolist() == [True]
    assert np.isnan([corner.sizes[0], narrow.sizes[0]]).all()
    assert narrow.centres[0].tolist() == [129.5, 119.5]
    assert whole.sizes[0] == pytest.approx(SIZE_OF_BOX * 60)


def test_tiny_boxes_slivers_and_crowds_are_neither_fruit_nor_background() -> None:
    assert not labels((100, 100, 13, 13), (100, 100, 80, 30)).counted.any()
    assert not labels((100, 100, 60, 60), crowd=True).counted.any()
    maps = box_targets(
        np.array([[10.0, 10.0]]), np.array([5.0]), np.array([[6.0, 6.0, 8.0, 8.0]]), np.array([False]), 20, 30
    )
    for part in (maps.belief, maps.offset_weight, maps.cornered, maps.peak, maps.reach_weight):
        assert part.max() == 0.0
    assert maps.weight[0, 6:14, 6:14].max() == maps.unlabelled[0, 6:14, 6:14].max() == 0.0
    assert maps.weight.sum() == maps.unlabelled.sum() == 20 * 30 - 8 * 8


def test_a_narrow_box_shows_at_most_its_part_of_a_disc() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200_000, 2))
    disc = points[np.hypot(*points.T) < 1.0]
    for shown in (0.3, 0.5, 0.8):
        part = (disc[:, 0] < 2.0 * shown - 1.0).mean()
        assert most_visible(np.array([0.0, 0.0, 0.85 * shown * 100.0, 100.0])) == pytest.approx(part, abs=0.005)
    assert most_visible(np.array([0.0, 0.0, 90.0, 100.0])) == 1.0


def test_looks_say_centre_size_and_box_as_the_detector_reads_them() -> None:
    K, rng = camera_of(640, 480), np.random.default_rng(3)
    for _ in range(20):
        centre, size = rng.uniform((50, 50), (590, 430)), rng.uniform(15.0, 80.0)
        look = look_at(K, centre + rng.normal(0, 0.1, 2) * size, size * 1.2, rng.normal(0.0, 0.1))
        u, v, log_size = look.label_place(centre, size)
        p_camera, _ = look.place(np.array([u, v, log_size, 0.0, -1.0, 0.0]))
        assert K[0, 0] * REFERENCE_LENGTH / p_camera[2] == pytest.approx(size, rel=1e-3)
        assert p_camera[:2] / p_camera[2] * K[0, 0] + K[:2, 2] == pytest.approx(centre, abs=1e-6)
        assert np.exp(log_size) == pytest.approx(1.0 / (1.2 * MARGIN), rel=0.01)
    upright = look_at(K, np.array([200.0, 100.0]), 40.0)
    box = np.array([180.0, 70.0, 50.0, 66.0])
    assert upright.place_box(upright.label_box(box)) == pytest.approx(box, abs=0.05)


def test_finder_batches_put_belief_on_labelled_fruit_and_repeat(photographs: PhotoSet) -> None:
    batches = PhotoFinderBatches(photographs.train, 12, 5, 9)
    first, again = batches[3], PhotoFinderBatches(photographs.train, 12, 5, 9)[3]
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    pictures, belief, _, _, offset_weight, cornered, unlabelled, peak, reaches, reach_weight = first
    assert pictures.shape == (12, 240, 320, 3)
    assert float(belief[:, :8].max()) == float(cornered.max()) == 0.0
    assert float(belief[:, 8].max()) > 0.9
    assert float(offset_weight.max()) == 1.0
    assert float((belief[:, 8:] * unlabelled).max()) < 0.8  # peaks lie inside of boxes
    there = peak[:, 0] > 0.0
    assert float(belief[:, 8][there].min()) > 0.75
    sides = reaches.permute(0, 2, 3, 1)[there]
    assert float(reach_weight.sum()) == pytest.approx(float(there.sum()), rel=0.1)
    across, down = (sides[:, :2] + sides[:, 2:]).unbind(1)
    assert 0.7 < float((across / down).median()) < 1.4  # discs have square boxes, unless the window cuts them
    assert fruit_scale(photographs.train) == pytest.approx(46.0 / 53.0, rel=0.15)


def test_close_look_batches_tell_fruit_from_what_nobody_labelled(photographs: PhotoSet) -> None:
    deceiving = {name: np.array([[200.0, 30.0, 30.0, 0.9]] * 20) for name in ("a_0.jpg", "a_1.jpg")}
    pictures, target, kind, visibility, known = PhotoCloseLookBatches(photographs.train, 64, 0, 1)[0]
    fruit = kind > 0.5
    assert pictures.shape == (64, 96, 96, 3)
    assert float(known[fruit][:, 2].max()) == float(known[fruit][:, 4].max()) == 0.0  # no box tells how fruit lies
    assert float(known[fruit][:, 3].mean()) > 0.8  # all but those that are turned most
    assert 0.3 < float(known[~fruit][:, 5].mean()) < 1.0  # a look at something small is at background
    assert float(target[fruit][:, :2].abs().max()) < 0.6
    assert float(visibility[fruit].min()) < 0.8 < float(visibility[fruit].max())  # one disc is cut
    without, taught = (
        float(PhotoCloseLookBatches(photographs.train, 200, 0, 1, places=places)[0][2].mean())
        for places in ({}, deceiving)
    )
    assert taught < without - 0.15  # what deceives the finder is taught as no fruit


def test_what_photographs_do_not_say_costs_nothing_and_what_they_may_have_left_out_little() -> None:
    torch.manual_seed(1)
    belief, offsets, weight = torch.zeros(1, 9, 6, 8), torch.zeros(1, 17, 6, 8), torch.ones(1, 1, 6, 8)
    target, none, reaches = torch.zeros(1, 9, 6, 8), torch.zeros(1, 1, 1, 1), torch.ones(1, 4, 6, 8)
    unlabelled, empty = torch.zeros(1, 1, 6, 8), torch.zeros(1, 1, 6, 8)
    unlabelled[..., :4] = 1.0

    def cost(changed: torch.Tensor) -> float:
        known = (target, weight, offsets, weight, none, unlabelled, empty, reaches, empty)
        return float(finder_loss((changed, offsets, reaches), *known))

    corners, sure, doubtful, labelled = (belief.clone() for _ in range(4))
    corners[:, :8] = 1.0
    sure[0, 8, 2, 1], doubtful[0, 8, 2, 1], labelled[0, 8, 2, 6] = 0.8, 0.4, 0.8
    base = cost(belief)
    assert base < 1e-6
    assert cost(corners) == base
    assert cost(doubtful) > 0.01
    assert cost(sure) == pytest.approx(DOUBTED * cost(labelled), rel=1e-3)  # inside of a box a second peak is wrong
    offsets[:, 16] = -1.0
    assert cost(sure) == pytest.approx(cost(labelled))  # what looks small is far behind, not left out

    output, truth, kind = torch.zeros(2, 15), torch.zeros(2, 10), torch.tensor([1.0, 0.0])
    bound, known = (
        torch.tensor([0.7, 0.0]),
        torch.tensor([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]),
    )

    def look_cost(row: int, column: int | slice, value: float) -> float:
        changed = output.clone()
        changed[row, column] = value
        return float(close_look_loss(changed, truth, kind, bound, known))

    base = float(close_look_loss(output, truth, kind, bound, known))
    for columns in (slice(0, 9), BOX):
        assert look_cost(0, columns, 0.7) == pytest.approx(base)
    assert look_cost(0, SEEN, -2.0) == pytest.approx(base)  # it may be less visible than its box allows
    assert look_cost(0, SEEN, 3.0) > base
    assert look_cost(1, KIND, 1.1) < base < look_cost(1, KIND, 0.9)  # sure of it: perhaps nobody labelled it


def test_mixed_batches_hold_frames_and_photographs(photographs: PhotoSet, tmp_path: Path) -> None:
    half = PhotoFinderBatches(photographs.train, 2, 1, 4)
    mixed = Mixed([half, PhotoFinderBatches(photographs.train, 3, 2, 4)], 4)
    assert len(mixed) == 4
    assert [len(part) for part in mixed[0]] == [5] * 10
    assert torch.equal(mixed[1][0][:2], half[1][0])
    outputs = FinderNetwork((8, 8, 8, 8))(mixed[0][0].permute(0, 3, 1, 2).float() / 255.0 - 0.5)
    loss = finder_loss(outputs, *mixed[0][1:])
    assert torch.isfinite(loss)


def test_in_a_picture_without_fruit_nothing_is_forgiven(photographs: PhotoSet) -> None:
    blank = replace(photographs.val[0], boxes=np.empty((0, 4)), crowd=np.zeros(0, np.bool_), empty=True)
    finder = PhotoFinderBatches(photographs.train, 24, 5, 9, empty=(blank,))[0]
    unlabelled, peak = finder[6], finder[7]
    without = (unlabelled.flatten(1).max(dim=1).values == 0.0) & (peak.flatten(1).max(dim=1).values == 0.0)
    assert 1 <= int(without.sum()) <= 9  # about an eighth
    looks = [PhotoCloseLookBatches(photographs.train, 60, 0, 1, empty=empty)[0] for empty in ((), (blank,))]
    doubted = [float(known[kind < 0.5][:, 5].mean()) for _, _, kind, _, known in looks]
    assert doubted[1] < doubted[0]


def test_a_folder_without_fruit_is_read_and_one_without_pictures_refused(tmp_path: Path) -> None:
    folder = tables(tmp_path / "set") / "images"
    read = read_empty(folder)
    assert len(read) == 4
    assert all(photo.empty and not len(photo.boxes) for photo in read)
    (folder / "broken.jpg").write_bytes(b"no picture")
    with pytest.raises(BadPhotographs, match=r"broken\.jpg: cannot be read as a picture"):
        read_empty(folder)
    (tmp_path / "bare").mkdir()
    with pytest.raises(BadPhotographs, match="bare: holds no pictures"):
        read_empty(tmp_path / "bare")
    with pytest.raises(BadPhotographs, match="nowhere: no such folder"):
        read_empty(tmp_path / "nowhere")
