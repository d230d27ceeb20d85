"""Figures of merit from scores alone."""

from pomona.tools.training.evaluation import Evaluation, Match, table


def test_recall_and_precision_follow_their_definitions() -> None:
    found = tuple(Match(1.0, s, 2.0, 1.0, 0.1, 5.0, float("nan")) for s in (0.9, 0.6, 0.4))
    hidden = Match(0.3, 0.95, 9.0, 9.0, 1.0, 90.0, float("nan"))
    result = Evaluation(1, (*found, hidden), (1.0,) * 4 + (0.3, 0.3), (0.7, 0.2), (0.0,))
    assert result.recall(0.5) == 0.5
    assert result.recall(0.5, least=0.0) == 0.5
    assert result.precision(0.5) == 3 / 4
    assert result.recall(0.99) == 0.0
    assert result.score_for(0.75) == 0.4
    assert result.score_for(0.8) is None
    text = table(result)
    assert "| 0.5 | 0.5000 | 0.7500 |" in text
    assert "| 60–100 % | 2 | 2.0 / 2.0 | 1.00 / 1.00 | 0.100 / 0.100 | 5.0 / 5.0 |  |  |" in text
    assert "| 20–40 % | 1 | 9.0 / 9.0 |" in text
