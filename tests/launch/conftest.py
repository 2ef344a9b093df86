"""What launches leave out where it is not the subject."""

import pytest


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Launches draw and report nothing, which takes most of their time."""
    from launch.jobs import recorder  # these import much: not what every test needs
    from launch.pictures import summary

    for module in (recorder, summary):
        monkeypatch.setattr(module, "write_index", lambda *_: None)
    monkeypatch.setattr(recorder, "write_figure", lambda path: None)
    monkeypatch.setattr(summary, "write_report", lambda path: None)
