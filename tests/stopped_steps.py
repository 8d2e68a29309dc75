"""Runs that stop after a step and go on: everything after it is the same to the last bit."""

import json

from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary


def assert_goes_on(mechanism, steps, end, chosen=lambda states: 12):
    """Of all states of a run, go on from the chosen one."""

    def begun():
        run = Run(mechanism, steps, end)
        return run, Recorder(run, end)

    def followed(run, tracker):
        for step, row in tracker.steps():
            yield run.state, tracker.state, (row, step.x.tolist())

    run, tracker = begun()
    *states, shown = zip(*followed(run, tracker), strict=True)
    number = chosen(states[0])
    again, follower = begun()
    again.state, follower.state = (own[number] for own in states)
    follower.take(tracker.history().each(lambda values: values[: number + 1]))
    found = [own for *_, own in followed(again, follower)]
    assert _text(found) == _text(shown[number + 1 :])
    assert _text(RunSummary(follower).entries()) == _text(RunSummary(tracker).entries())


def _text(values):
    """Every digit, whether NumPy's numbers or Python's; what is not a number yet is itself."""
    return json.dumps(values, default=lambda value: value.item())
