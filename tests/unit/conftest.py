"""What the unit tests of exhibits share."""

import pytest

from modlhmp.study.layout import Layout


@pytest.fixture
def layout(tmp_path):
    """Where a run's files lie in the test's own folder."""
    return Layout("demo", str(tmp_path))


@pytest.fixture
def figures(monkeypatch):
    """Figures that have been drawn; they stay open."""
    from modlhmp.study.exhibits import style  # noqa: PLC0415 - matplotlib, which most unit tests do without

    shown = []
    monkeypatch.setattr(style.plt, "close", shown.append)
    yield shown
    monkeypatch.undo()
    for fig in shown:
        style.plt.close(fig)
