"""Triangular factors of every column that a joint may have, for any choice among them."""

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.samples import FOLDS
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import JointTerm
from aerarm_ros.identification.regression.reduced_regression import (
    ReducedRegression,
    triangular_factor,
)
from aerarm_ros.identification.regression.sample_columns import SampleColumns

Array = npt.NDArray[np.float64]


class RegressionBank:
    """Reduces the identification bags once; models are then compared without touching samples.

    A joint's terms act on its own torque only, so its rows need the links' columns and its
    own candidates: one factor for each joint and each part of the motion.

    Parameters
    ----------
    bags : sequence of SampleColumns
    terms : sequence of JointTerm
        Candidates of every joint.
    inertial : (10 n,) ndarray, optional
        Inertial parameters that give the load of terms that depend on it.
    row_weights : sequence of (M, n) arrays, optional
        Factor of each bag's rows.
    """

    def __init__(
        self,
        bags: Sequence[SampleColumns],
        terms: Sequence[JointTerm],
        inertial: Array | None = None,
        row_weights: Sequence[Array] | None = None,
    ) -> None:
        self.terms = tuple(dict.fromkeys(terms))
        self.n = bags[0].samples.n
        columns = [[bag.term(term, inertial) for term in self.terms] for bag in bags]
        self._factors: list[list[Array]] = []
        self._rows = np.zeros((self.n, FOLDS), dtype=np.intp)
        for joint in range(self.n):
            blocks = [
                bag.weights[joint]
                * np.column_stack(
                    [bag.rigid[:, joint]]
                    + [column[:, joint] for column in own]
                    + [bag.samples.tau[:, joint]]
                )
                for bag, own in zip(bags, columns, strict=True)
            ]
            if row_weights is not None:
                blocks = [
                    weights[:, joint, None] * block
                    for weights, block in zip(row_weights, blocks, strict=True)
                ]
            self._factors.append([])
            for fold in range(FOLDS):
                rows = np.vstack(
                    [
                        block[bag.samples.usable[:, joint] & (bag.samples.fold == fold)]
                        for bag, block in zip(bags, blocks, strict=True)
                    ]
                )
                self._rows[joint, fold] = len(rows)
                self._factors[joint].append(triangular_factor(rows))

    def regression(
        self, model: JointModel, folds: Iterable[int] = range(FOLDS)
    ) -> ReducedRegression:
        """Return the regression of one model on some parts of the motion.

        Parameters
        ----------
        model : JointModel
            Its terms must be among the bank's.
        folds : iterable of int
        """
        folds = list(folds)
        joint_columns = model.joint_columns
        factors = []
        for joint in range(self.n):
            own = [(i, t) for i, (j, t) in enumerate(joint_columns) if j == joint]
            source = np.vstack([self._factors[joint][fold] for fold in folds])
            links = 10 * self.n
            spread = np.zeros((len(source), links + len(joint_columns) + 1))
            spread[:, :links] = source[:, :links]
            for index, term in own:
                spread[:, links + index] = source[:, links + self.terms.index(term)]
            spread[:, -1] = source[:, -1]
            factors.append(triangular_factor(spread))
        return ReducedRegression(model.columns, factors, self._rows[:, folds].sum(axis=1))

    def factor(self, joint: int, fold: int) -> Array:
        """Return one joint's factor on one part: links, candidates, torque."""
        return self._factors[joint][fold]
