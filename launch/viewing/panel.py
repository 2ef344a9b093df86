"""The panel beside the picture, as HTML: the state of each level, and outcomes of subgoals."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape

import hac_suite
from launch.pictures.outcomes import COLOURS, SIGNS
from launch.pictures.stage import Stage
from launch.pictures.subgoal_log import WORDS
from launch.viewing.episode import Ended, Episode, LevelStatus

_STYLE = "font-size:0.875rem;line-height:1.45;padding:0 0.75em 0.5em"
_NO_CHIP = "transparent"
_NO_CRITICS = "Q is not shown: this policy was saved without its critics."
_ABOUT_Q = "Q: about minus the attempts that the level still expects to need."
_QUIET = "opacity:0.75"


def status(episode: Episode, max_steps: int, title: str) -> str:
    """What is to be done, and how the episode stands."""
    if episode.succeeded:
        said = f"<b>goal achieved</b> in {episode.step} steps"
    elif episode.over:
        said = f"<b>ended</b> after {episode.step} steps: the goal was not achieved"
    else:
        said = f"step {episode.step} of {max_steps}"
    return f'<div style="{_STYLE}">{escape(title)}<br>{said}</div>'


def levels(
    statuses: Sequence[LevelStatus], counts: Mapping[int, Mapping[int, int]], stage: Stage
) -> str:
    """A row for each level, the top first: its goal's colour, attempts left, Q, and outcomes."""
    top = len(statuses) - 1
    with_values = all(status.value is not None for status in statuses)
    heads = ["goal", "attempts left", *(["Q"] if with_values else []), "so far"]
    rows = []
    for status in reversed(statuses):
        at_top = status.level == top
        cells = [
            _chip(_colour(stage, status.level, top))
            + ("end goal" if at_top else f"level {status.level + 1}'s subgoal")
            + f'<br><span style="{_QUIET}">pursued by level {status.level}</span>',
            _attempts(status),
            *([f"{status.value:.1f}"] if with_values else []),
            "" if at_top else _counts(counts.get(status.level + 1, {})),
        ]
        style = "padding:0.25em 0.35em;white-space:nowrap"
        rows.append("".join(f'<td style="{style}">{cell}</td>' for cell in cells))
    header = "".join(f'<th style="text-align:left;padding:0 0.35em">{head}</th>' for head in heads)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    note = _ABOUT_Q if with_values else _NO_CRITICS
    note = f'<div style="{_QUIET};padding-top:0.4em">{note}</div>'
    return (
        f'<div style="{_STYLE}"><table style="border-collapse:collapse;width:100%">'
        f"<tr>{header}</tr>{body}</table>{note}</div>"
    )


def endings(recent: Iterable[Ended]) -> str:
    """The latest endings of subgoals, the newest first."""
    lines = [
        f'<div><span style="color:{COLOURS[ended.outcome]}">{SIGNS[ended.outcome]}</span> '
        f"step {ended.step}: {escape(str(ended))}</div>"
        for ended in recent
    ]
    nothing = f'<div style="{_QUIET}">no subgoal has ended yet</div>'
    return f'<div style="{_STYLE}">{"".join(lines) or nothing}</div>'


def _attempts(status: LevelStatus) -> str:
    if status.allowed is None:
        return f"{status.made} made"
    return f"{status.allowed - status.made} of {status.allowed}"


def _counts(tally: Mapping[int, int]) -> str:
    parts = [
        f'<span style="color:{COLOURS[outcome]};white-space:nowrap" title="{word}">'
        f"{SIGNS[outcome]} {tally.get(outcome, 0)}</span>"
        for outcome, word in WORDS.items()
    ]
    return " ".join(parts)


def _colour(stage: Stage, level: int, top: int) -> str:
    """The colour of the marker of what a level pursues."""
    if level == top:
        return stage.colour(stage.goal) or _NO_CHIP
    shown = level < len(stage.subgoals)
    return (stage.colour(stage.subgoals[level]) if shown else None) or _NO_CHIP


def _chip(colour: str) -> str:
    return (
        f'<span style="display:inline-block;width:0.8em;height:0.8em;margin-right:0.4em;'
        f'border:1px solid #888;border-radius:2px;background:{colour}"></span>'
    )


def hint(text: str) -> str:
    """A line of advice."""
    return f'<div style="{_STYLE};{_QUIET}">{escape(text)}</div>'


def key() -> str:
    """What the signs of outcomes mean."""
    parts = [
        f'<span style="color:{COLOURS[outcome]};white-space:nowrap">{SIGNS[outcome]} {word}</span>'
        for outcome, word in WORDS.items()
        if outcome is not hac_suite.Outcome.OPEN
    ]
    return f'<div style="{_STYLE}">{" &nbsp; ".join(parts)}</div>'
