"""The tree that the language was made for: read, checked, built and run."""

from __future__ import annotations

from pomona.executive.reasons import reason_of


def test_it_has_no_findings(findings_of, pick_apple):
    assert findings_of(pick_apple) == []


def test_it_picks(built, pick_apple):
    run = built(pick_apple)
    assert run.run() == "SUCCESS"
    assert run.value("/hold").value == "soft"
    assert "/perceive/detection" in run.tree.board.entries


def test_nodes_have_stable_paths_and_places(built, pick_apple):
    nodes = {info.path: info for info in built(pick_apple).tree.nodes}
    assert list(nodes)[:4] == [
        "pick_apple",
        "pick_apple/perceive:retry",
        "pick_apple/perceive",
        "pick_apple/perceive/sequence",
    ]
    plan = nodes["pick_apple/Attempt/fallback/Plan#2"]
    assert plan.parent == "pick_apple/Attempt/fallback/Plan#2:when"
    assert plan.line == 20
    assert plan.inputs["planner"] == "RRTstar"
    assert plan.failures == ("NO_PATH", "TIMEOUT", "GOAL_IN_COLLISION")
    assert (
        nodes["pick_apple/Attempt"].comment
        == "one attempt; every try takes the next sample of the sphere"
    )
    assert nodes["pick_apple/Attempt:on_failure"].parent == "pick_apple/Attempt:retry"
    assert all(info.parent is None or info.parent in nodes for info in nodes.values())


def test_second_plan_runs_only_after_the_codes_that_it_is_for(built, pick_apple):
    run = built(pick_apple)
    run.script("pick_apple/Attempt/fallback/Plan", "NO_PATH").run()
    assert run.skill("pick_apple/Attempt/fallback/Plan#2").starts == 1
    run = built(pick_apple, overrides=["attempts=2"])
    run.script("pick_apple/Attempt/fallback/Plan", "GOAL_IN_COLLISION")
    assert run.run() == "FAILURE"
    assert run.skill("pick_apple/Attempt/fallback/Plan#2").starts == 0


def test_retreat_follows_every_failed_attempt_and_feeds_the_tried_grasp_back(built, pick_apple):
    run = built(pick_apple).script("pick_apple/Attempt/Approach", "CONTACT", "CONTACT", None)
    assert run.run() == "SUCCESS"
    assert run.skill("pick_apple/Attempt:on_failure").starts == 2
    assert run.skill("pick_apple/Attempt/SampleGrasp").seen["tried"].index == 2
    attempts = run.tree.behaviours["pick_apple/Attempt:retry"].attempts
    assert [attempt.status.name for attempt in attempts] == ["FAILURE", "FAILURE", "SUCCESS"]


def test_a_failure_lists_everything_that_led_to_it(built, pick_apple):
    run = built(pick_apple, overrides={"attempts": "2"}).script(
        "pick_apple/Attempt/Lift", "DROPPED"
    )
    assert run.run() == "FAILURE"
    reason = reason_of(run.tree.root)
    assert reason.code == "DROPPED"
    assert [leaf.node_path for leaf in reason.leaves()] == ["pick_apple/Attempt/Lift"] * 2
    assert [leaf.data["start"] for leaf in reason.leaves()] == [1, 2]


def test_looks_vary_with_the_number_of_the_try(built, pick_apple):
    run = built(pick_apple).script(
        "pick_apple/perceive/sequence/Detect", "NO_FRUIT", "NO_FRUIT", None
    )
    assert run.run() == "SUCCESS"
    assert run.skill("pick_apple/perceive/sequence/MoveTo").seen == {
        "pose": "observe",
        "variation": 3,
    }
