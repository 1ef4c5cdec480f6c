import numpy as np

from aerarm_ros.energy.energy_model import HoldingLoss


def test_the_gradient_is_that_of_the_loss(model) -> None:
    loss = HoldingLoss(model)
    rng = np.random.default_rng(3)
    for q in rng.uniform(-1.5, 1.5, (5, 4)):
        numeric = [
            (loss.watts(q + step) - loss.watts(q - step)) / 2e-6 for step in 1e-6 * np.eye(4)
        ]
        np.testing.assert_allclose(loss.gradient(q), numeric, atol=1e-5)


def test_upright_costs_next_to_nothing_and_stretched_out_costs_watts(model) -> None:
    loss = HoldingLoss(model)
    upright = loss.watts(np.array([0.0, np.pi / 2, 0.0, 0.0]))
    assert upright < 0.01 < 1.0 < loss.watts(np.zeros(4))
