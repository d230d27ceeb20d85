"""The fitted score: a net of tanh units over four logits."""

import numpy as np
import pytest

from pomona.skills.perception.detection.fused_score import FusedScore, read_fused_score


def test_the_score_is_the_nets_own_arithmetic_and_survives_its_file() -> None:
    hidden, output = np.array([[0.5, 0.0, 1.0, 0.0, -0.2], [0.0, 0.1, 0.0, 2.0, 0.3]]), np.array([1.5, -0.5, 0.25])
    score = FusedScore(hidden, output)
    units = np.tanh([0.5 * 2.0 + 1.0 * -1.0 - 0.2, 0.1 * 3.0 + 2.0 * 0.5 + 0.3])
    expected = 1.0 / (1.0 + np.exp(-(1.5 * units[0] - 0.5 * units[1] + 0.25)))
    features = np.array([[2.0, 3.0, -1.0, 0.5]])
    assert score.of(features) == pytest.approx([expected])
    assert read_fused_score(score.content()).of(features) == pytest.approx([expected])


def test_logits_without_bound_give_scores_between_zero_and_one() -> None:
    score = FusedScore(np.ones((1, 5)), np.array([3.0, 0.0]))
    values = score.of(np.array([[np.inf] * 4, [-np.inf] * 4, [np.nan] * 4]))
    assert ((values >= 0.0) & (values <= 1.0)).all()


@pytest.mark.parametrize(
    "content",
    [
        {"hidden": [[1.0, 2.0]], "output": [1.0, 2.0]},
        {"hidden": [[1.0] * 5], "output": [1.0]},
        {"hidden": [[float("nan")] * 5], "output": [1.0, 0.0]},
    ],
)
def test_a_net_of_another_form_is_refused(content: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="a net"):
        read_fused_score(content)
