"""Numbers that a test both asserts and lends to the validation page of the documentation.

``pytest --figures=FILE tests`` runs the tests with such numbers alone and writes them to FILE,
if all pass; `make figures` does that for ``docs/validation.json``. A test that is skipped, for a
program that is not installed for instance, has no numbers: then nothing is written but the reason.
"""

import json
from pathlib import Path

import pytest

RECORDED = pytest.StashKey[list]()
SKIPPED = pytest.StashKey[list]()


def pytest_addoption(parser):
    parser.addoption("--figures", metavar="FILE", help="run the tests with figures, write them")


def pytest_configure(config):
    config.stash[RECORDED], config.stash[SKIPPED] = [], []


def pytest_collection_modifyitems(config, items):
    """Deselect all other tests if figures are asked for."""
    if config.getoption("--figures"):
        chosen = [item for item in items if "figure" in item.fixturenames]
        config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
        items[:] = chosen
        missing = sorted({reason for item in chosen for reason in _reasons(item)})
        if missing:
            raise pytest.UsageError(f"no figures are written: {'; '.join(missing)}")


def _reasons(item):
    """Why a test is going to be skipped, as far as its marks say."""
    for mark in item.iter_markers("skipif"):
        if any(mark.args):
            yield f"{item.path.name}: {mark.kwargs['reason']}"


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    report = (yield).get_result()
    if report.skipped and isinstance(report.longrepr, tuple):  # else it was expected to fail
        item.config.stash[SKIPPED].append(f"{item.nodeid}: {report.longrepr[2]}")


def pytest_sessionfinish(session, exitstatus):
    config = session.config
    path = config.getoption("--figures")
    if path and exitstatus == 0 and config.stash[SKIPPED]:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        lines = "; ".join(config.stash[SKIPPED])
        config.get_terminal_writer().line(f"\nno figures are written: {lines}")
    elif path and exitstatus == 0:
        from fenics_ehd.base.files import versions

        document = {"versions": versions(), "figures": config.stash[RECORDED]}
        Path(path).write_text(json.dumps(document, indent=1) + "\n")


@pytest.fixture
def figure(request):
    """``figure(group, name, value, most=..., unit=...)`` asserts the limit; or `least`."""

    def check(group, name, value, *, most=None, least=None, unit=""):
        if least is None:
            assert value <= most, f"{name}: {value:g}, at most {most:g}"
        else:
            assert value >= least, f"{name}: {value:g}, at least {least:g}"
        entry = {"group": group, "name": name, "value": float(value), "unit": unit}
        entry |= {"most": most} if least is None else {"least": least}
        test = request.node.nodeid
        request.config.stash[RECORDED].append(entry | {"test": test[test.find("test_") :]})

    return check
