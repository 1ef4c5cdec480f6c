"""The best iterate comes first, infeasible ones never."""

import numpy as np

from aerarm_ros.excitation.design_problem import FeasibleIterates


def test_best_first_and_only_feasible_ones() -> None:
    iterates = FeasibleIterates()
    assert iterates.best() == []
    for step in range(1, 41):
        # Every third breaks a constraint; the objective falls all the time.
        iterates.see(
            np.full(2, step), -float(step), np.array([1.0, -0.5 if step % 3 == 0 else 0.0])
        )
    best = iterates.best()
    assert best[0][1] == 40
    assert all(number % 3 for _, number in best)
    assert [number for _, number in best] == sorted((n for _, n in best), reverse=True)
    np.testing.assert_array_equal(best[0][0], [40.0, 40.0])
    np.testing.assert_array_equal(iterates.last, [40.0, 40.0])


def test_iterates_are_copies() -> None:
    iterates, x = FeasibleIterates(), np.zeros(2)
    iterates.see(x, 0.0, np.array([]))
    x[:] = 7.0
    np.testing.assert_array_equal(iterates.best()[0][0], 0.0)
