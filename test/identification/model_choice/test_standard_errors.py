"""Sums over blocks, and what chance makes of them."""

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.uniform_motion import BLOCKS
from aerarm_ros.identification.model_choice.simple_fit import block_sums, standard_errors


def test_blocks_of_each_bag_are_summed_over_joints_and_unknown_ones_left_out() -> None:
    block = np.array([0, 0, 1])
    residual = np.array([[1.0, 2.0], [3.0, np.nan], [np.nan, 4.0]])
    sums = block_sums([block, block], [residual, 2.0 * residual]).sum(axis=1)
    assert sums[[0, 1, BLOCKS, BLOCKS + 1]] == pytest.approx([14.0, 16.0, 56.0, 64.0])
    assert len(sums) == 2 * BLOCKS
    only = np.array([[True, False], [False, False], [False, True]])
    assert block_sums([block], [residual], [only])[:2] == pytest.approx(np.diag([1.0, 16.0]))


def test_a_steady_difference_is_many_standard_errors() -> None:
    random = np.random.default_rng(0).standard_normal(25)
    assert standard_errors(random - random.mean() + 1.0) > 3.0
    assert abs(standard_errors(random - random.mean())) < 1e-9
    assert standard_errors(np.zeros(25)) == 0.0
