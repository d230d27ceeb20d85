from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks.bench_problems import main, run_set
from benchmarks.motion_bench_maker import BadProblem, problem_sets, read_problems
from tests.skills.picking_scene import HOME, OBSERVE, ROBOT_MODEL


def write(folder, number: int, goal: np.ndarray, **thing: Any) -> None:
    names = list(ROBOT_MODEL.joint_names)
    scene = {
        "world": {"collision_objects": [thing] if thing else []},
        "allowed_collision_matrix": {
            "entry_names": ["base", "link_s"],
            "entry_values": [[False, True], [True, False]],
        },
    }
    request = {
        "start_state": {"joint_state": {"name": names, "position": [float(x) for x in OBSERVE]}},
        "goal_constraints": [
            {
                "joint_constraints": [
                    {"joint_name": name, "position": float(x)}
                    for name, x in zip(names, goal, strict=True)
                ]
            }
        ],
    }
    folder.mkdir(exist_ok=True)
    (folder / f"scene{number:04}.yaml").write_text(yaml.safe_dump(scene))
    (folder / f"request{number:04}.yaml").write_text(yaml.safe_dump(request))


def box(position: list[float], size: list[float]) -> dict[str, object]:
    return {
        "id": "crate",
        "primitives": [{"type": "box", "dimensions": size}],
        "primitive_poses": [{"position": position, "orientation": [0.0, 0.0, 0.0, 1.0]}],
    }


def test_scenes_and_requests_become_problems(tmp_path):
    folder = tmp_path / "shelf"
    write(folder, 1, HOME, **box([0.4, 0.4, 0.1], [0.1, 0.2, 0.3]))
    write(folder, 2, HOME)
    assert problem_sets(tmp_path) == (folder,)
    first, second = read_problems(folder, ROBOT_MODEL)
    np.testing.assert_allclose(first.q_start, OBSERVE)
    np.testing.assert_allclose(first.q_goal, HOME)
    crate = next(o for o in first.world.obstacles if o.name == "crate")
    np.testing.assert_allclose(
        crate.distance(np.array([[0.4, 0.4, 0.35], [0.4, 0.4, 0.1]])), [0.1, -0.05], atol=1e-9
    )
    assert second.world.obstacles == ()


def test_solved_unsolved_and_invalid_are_distinguished(tmp_path):
    folder = tmp_path / "shelf"
    write(folder, 1, HOME)
    at_goal = ROBOT_MODEL.tcp(HOME)[:3, 3]
    write(folder, 2, HOME, **box([float(x) for x in at_goal], [0.1, 0.1, 0.1]))
    attempts = run_set(read_problems(folder, ROBOT_MODEL), "RRTConnect", 1.0, 0)
    assert [attempt.valid for attempt in attempts] == [True, False]
    assert attempts[0].length == pytest.approx(np.linalg.norm(HOME - OBSERVE))


def test_the_benchmark_prints_solved_median_and_p95(tmp_path, capsys):
    write(tmp_path / "shelf", 1, HOME)
    assert main(["--problems", str(tmp_path), "--robot", str(ROBOT_MODEL.path)]) == 0
    out = capsys.readouterr().out
    assert "shelf" in out
    assert "solved 1 of 1, median" in out
    assert "p95" in out


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("request0001.yaml", "start_state: {}\n", "start and goal of every joint"),
        ("request0001.yaml", "[1, 2\n", "cannot be read"),
        ("scene0001.yaml", "world: {collision_objects: [{id: a}]}\n", "boxes and cylinders"),
        ("scene0001.yaml", "- 1\n", "is no mapping"),
    ],
)
def test_a_file_that_is_wrong_is_named(tmp_path, name, content, says):
    folder = tmp_path / "shelf"
    write(folder, 1, HOME)
    (folder / name).write_text(content)
    with pytest.raises(BadProblem, match=says) as bad:
        list(read_problems(folder, ROBOT_MODEL))
    assert bad.value.path.name == name


def test_an_empty_folder_is_reported(tmp_path):
    with pytest.raises(BadProblem, match=r"holds no request\*\.yaml"):
        problem_sets(tmp_path)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (["--robot", "nowhere.urdf"], "there is no such file"),
        (["--tool", "nose"], "has no site or body named 'nose'"),
        (["--problems", "nowhere"], "holds no request"),
    ],
)
def test_bad_input_of_the_benchmark_is_reported_in_one_line(tmp_path, capsys, changed, says):
    write(tmp_path / "shelf", 1, HOME)
    assert main(["--problems", str(tmp_path), "--robot", str(ROBOT_MODEL.path), *changed]) == 2
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1


def test_a_joint_that_is_rounded_beyond_its_limit_is_put_back_to_it(tmp_path):
    folder, beyond = tmp_path / "shelf", HOME.copy()
    beyond[0] = ROBOT_MODEL.upper[0] + 5e-4
    write(folder, 1, beyond)
    beyond[0] = ROBOT_MODEL.upper[0] + 0.1
    write(folder, 2, beyond)
    rounded, wrong = read_problems(folder, ROBOT_MODEL)
    assert rounded.q_goal[0] == ROBOT_MODEL.upper[0]
    assert wrong.q_goal[0] == beyond[0]
