"""Per-level diagnostics: means over the seeds that have them."""

import numpy as np
import pandas as pd
import pytest

from analysis.figures.diagnostics import draw_diagnostics, level_means


def _curve(means: pd.DataFrame, layers: int, level: int, quantity: str) -> list[tuple]:
    chosen = means[
        (means["subgoal_layers"] == layers)
        & (means["level"] == level)
        & (means["quantity"] == quantity)
    ]
    return list(chosen[["period", "n", "mean"]].itertuples(index=False, name=None))


def test_missed_subgoals_by_hand(make_results):
    # The made-up achieved share of subgoals equals the success rate.
    means = level_means(make_results({0: [[0.0, 0.5]], 1: [[0.0, 0.75, 1.0], [0.5, 0.25, 0.5]]}))
    assert _curve(means, 1, 1, "missed") == [(1, 2, 0.5), (2, 2, 0.25)]
    assert _curve(means, 1, 0, "missed") == []
    assert _curve(means, 0, 0, "missed") == []
    assert _curve(means, 0, 0, "q_mean") == [(0, 1, -5.0), (1, 1, -5.0)]
    assert _curve(means, 1, 1, "q_mean") == [(0, 2, -6.0), (1, 2, -6.0), (2, 2, -6.0)]


def test_a_seed_that_proposed_nothing_is_left_out_and_n_says_so(make_results):
    results = make_results({1: [[0.0, 0.75, 1.0], [0.5, 0.25, 0.5]]})
    results.loc[1, "level1_achieved"] = np.nan
    means = level_means(results)
    assert _curve(means, 1, 1, "missed") == [(1, 1, 0.75), (2, 2, 0.25)]


def test_results_without_diagnostics_are_drawn_empty(make_results):
    results = make_results({0: [[0.0]], 2: [[0.0]]})
    bare = results.drop(columns=[name for name in results if name.startswith("level")])
    assert level_means(bare).empty
    texts = [ax.texts[0].get_text() for ax in draw_diagnostics(bare).axes]
    assert texts == ["proposes no subgoals"] * 2 + ["no data"] * 2


def test_a_panel_per_agent_and_quantity_with_a_line_per_level(make_results):
    figure = draw_diagnostics(
        make_results({0: [[0, 0.5, 0.5]], 2: [[0, 0.5, 0.75], [0, 0.5, None]]})
    )
    missed_flat, missed, q_flat, q_values = figure.axes
    assert not missed_flat.lines and missed_flat.texts
    labels = [text.get_text() for text in missed.get_legend().get_texts()]
    assert labels == ["level 1 (n=1-2)", "level 2 (n=1-2)"]
    np.testing.assert_array_equal(missed.lines[0].get_ydata(), [0.5, 0.25])
    assert len(q_flat.lines) == 1 and len(q_values.lines) == 3


@pytest.mark.parametrize("level", [3, 4])
def test_levels_beyond_the_papers_are_found(make_results, level):
    results = make_results({level: [[0.0, 0.5]]})
    means = level_means(results.assign(**{f"level{level}_q_mean": -3.0}))
    assert _curve(means, level, level, "q_mean") == [(0, 1, -3.0), (1, 1, -3.0)]
