import threading
import time

from aerarm_ros.realtime import periodic_loop
from aerarm_ros.realtime.periodic_loop import CycleSlack


def test_work_begins_when_a_cycle_ends(monkeypatch):
    monkeypatch.setattr(periodic_loop, '_PATIENCE', 3600.0)
    slack, begun = CycleSlack(), threading.Event()
    slack.begin()  # a cycle that ended before anybody waited does not count

    def work():
        slack.wait()
        begun.set()

    thread = threading.Thread(target=work)
    thread.start()
    assert not begun.wait(0.05)
    end = time.monotonic() + 60.0
    while not begun.is_set() and time.monotonic() < end:
        slack.begin()
        time.sleep(1e-3)
    assert begun.is_set()
    thread.join()


def test_waiting_for_a_stopped_loop_ends_soon():
    CycleSlack().wait()
