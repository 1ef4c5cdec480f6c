"""Real-time requests of a loop to the system, granted and refused."""

import gc
from types import SimpleNamespace

import pytest

from aerarm_ros.ros.parameters import shared_parameters
from aerarm_ros.ros.parameters.shared_parameters import prepare_thread


class Logger:
    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


def warnings(**given: object) -> list[str]:
    """Return what a thread logs that requests these settings."""
    nothing = {'realtime_priority': 0, 'lock_memory': False, 'keep_cpus_awake': False}
    logger = Logger()
    prepare_thread(SimpleNamespace(**{**nothing, **given}), logger)
    return logger.warnings


@pytest.fixture(autouse=True)
def collector_as_before():
    yield
    gc.unfreeze()
    gc.enable()


def test_the_garbage_collector_stops_unless_it_is_wanted() -> None:
    assert warnings(freeze_gc=False, cpus=[]) == []
    assert gc.isenabled()
    assert warnings() == []
    assert not gc.isenabled()


def test_a_rejected_request_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_parameters, 'set_fifo', lambda priority: 'no right')
    monkeypatch.setattr(shared_parameters, 'keep_cpus_awake', lambda: 'CPUs may sleep')
    assert warnings() == []
    assert warnings(realtime_priority=70) == ['no right']
    assert warnings(keep_cpus_awake=True) == ['CPUs may sleep']
