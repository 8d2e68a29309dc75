"""``fenics-ehd check``: what it says of an installation that works, and of one that does not."""

import pytest

from fenics_ehd.cli import check
from fenics_ehd.cli.main import main


@pytest.mark.slow
def test_an_installation_tests_itself(monkeypatch, capsys):
    with pytest.raises(SystemExit) as end:
        main(["check"])
    assert end.value.code == 0
    printed = capsys.readouterr().out
    assert printed.endswith("all is well\n")
    assert "attitude angle 51.9" in printed
    # And says so where it does not work.
    monkeypatch.setitem(check.CHECKS, "film", lambda _: check._within(50.0, 51.98, 0.1, "{:.2f}"))
    for name in ("reduction", "steps", "two ranks"):
        monkeypatch.delitem(check.CHECKS, name)
    with pytest.raises(SystemExit) as end:
        main(["check"])
    assert end.value.code == 1
    assert "film" in capsys.readouterr().err
