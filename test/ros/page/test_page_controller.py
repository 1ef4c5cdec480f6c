"""Controller that the page starts; test/nodes/test_view_actions.py checks its end."""

import threading

import pytest

from aerarm_ros.ros.page.page_controller import PageController

CLICKS = 6


def test_clicks_at_the_same_time_start_one_controller(ros_domain: dict[str, str]) -> None:
    controller = PageController('/', {})
    with pytest.raises(ValueError, match='unknown controller'):
        controller.start('arm', 0.5)
    together = threading.Barrier(CLICKS)
    refused: list[str] = []

    def click() -> None:
        together.wait(60.0)
        try:
            controller.start('gravity_compensation', 0.5)
        except RuntimeError as error:
            refused.append(str(error))
        together.wait(60.0)  # a node ends with the thread that started it

    threads = [threading.Thread(target=click) for _ in range(CLICKS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    controller.close()
    problem = 'gravity_compensation is already running: stop it first'
    assert refused == [problem] * (CLICKS - 1)
