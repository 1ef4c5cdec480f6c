"""Real-time requests of a loop to the system, granted and refused."""

import gc
from types import SimpleNamespace

import pytest

from aerarm_ros.ros.parameters import shared_parameters
from aerarm_ros.ros.parameters.shared_parameters import prepare_thread

NOTHING = {'realtime_priority': 0, 'lock_memory': False, 'keep_cpus_awake': False}


class Logger:
    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


@pytest.fixture(autouse=True)
def collector_as_before():
    yield
    gc.unfreeze()
    gc.enable()


def test_the_garbage_collector_stops_unless_it_is_wanted() -> None:
    values = SimpleNamespace(**NOTHING)
    logger = Logger()
    prepare_thread(SimpleNamespace(**vars(values), freeze_gc=False, cpus=[]), logger)
    assert gc.isenabled()
    prepare_thread(values, logger)
    assert not gc.isenabled()
    assert logger.warnings == []


def test_a_refusal_is_a_warning(monkeypatch) -> None:
    refusal = 'no right to SCHED_FIFO: raise rtprio in /etc/security/limits.d'
    monkeypatch.setattr(shared_parameters, 'set_fifo', lambda priority: refusal)
    logger = Logger()
    prepare_thread(SimpleNamespace(**{**NOTHING, 'realtime_priority': 70}), logger)
    assert logger.warnings == [refusal]


def test_keep_cpus_awake_is_requested(monkeypatch) -> None:
    refusal = 'CPUs may sleep between cycles'
    monkeypatch.setattr(shared_parameters, 'keep_cpus_awake', lambda: refusal)
    logger = Logger()
    prepare_thread(SimpleNamespace(**NOTHING), logger)
    assert logger.warnings == []
    prepare_thread(SimpleNamespace(**{**NOTHING, 'keep_cpus_awake': True}), logger)
    assert logger.warnings == [refusal]
