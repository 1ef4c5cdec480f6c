import pytest

from aerarm_ros.control.compensation import Fade


def test_comes_and_goes_in_its_time() -> None:
    fade = Fade(0.5, share=0.0)
    assert [fade.update(0.1, is_on=True) for _ in range(6)] == pytest.approx(
        [0.2, 0.4, 0.6, 0.8, 1.0, 1.0]
    )
    assert [fade.update(0.25, is_on=False) for _ in range(3)] == pytest.approx([0.5, 0.0, 0.0])


def test_turns_round_where_it_is() -> None:
    fade = Fade(1.0, share=0.5)
    assert fade.update(0.1, is_on=True) == pytest.approx(0.6)
    assert fade.update(0.1, is_on=False) == pytest.approx(0.5)
