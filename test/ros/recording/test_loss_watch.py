from aerarm_ros.ros.recording import LossWatch


def test_new_losses_are_told_once() -> None:
    watch = LossWatch(4000)
    assert watch.news({}) == ''
    assert watch.news({'/a': (10, 0), '/b': (5, None)}) == ''
    text = watch.news({'/a': (20, 3), '/b': (9, None), '/c': (1, 7)})
    assert '3 of /a, 7 of /c just now' in text
    assert '/b' not in text
    assert 'depth, 4000 now' in text
    assert watch.news({'/a': (30, 3), '/b': (12, None), '/c': (2, 7)}) == ''
    assert ' 2 of /a just now' in watch.news({'/a': (40, 5), '/c': (3, 7)})


def test_a_guess_that_is_taken_back_is_no_loss() -> None:
    watch = LossWatch(10)
    assert watch.news({'/a': (1, 100)})
    assert watch.news({'/a': (2, 0)}) == ''
