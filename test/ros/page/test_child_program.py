"""A node that the page starts; test_view_actions.py checks its end."""

import threading
from pathlib import Path

from aerarm_ros.ros.page.page_programs import ChildProgram

CLICKS = 6


def test_clicks_at_the_same_time_start_one_node(ros_domain: dict[str, str], tmp_path: Path) -> None:
    program = ChildProgram('/')
    together = threading.Barrier(CLICKS)
    refused: list[str] = []

    def click() -> None:
        together.wait(60.0)
        try:
            program.start('recorder', {'bag': tmp_path / 'bag'})
        except RuntimeError as error:
            refused.append(str(error))
        together.wait(60.0)  # a node ends with the thread that started it

    threads = [threading.Thread(target=click) for _ in range(CLICKS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    program.close()
    assert refused == ['recorder is already running: stop it first'] * (CLICKS - 1)
