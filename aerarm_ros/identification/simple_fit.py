"""Fit of a simple torque model, with residuals on held-out parts of the motion."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.uniform_motion import BLOCKS, FOLDS
from aerarm_ros.identification.joint_model import ROTOR, ArmParameters, JointTerm, TermKind
from aerarm_ros.identification.model_fit import LINK_SPREAD
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.motion.signals import Array


def block_sums(
    blocks: Sequence[npt.NDArray[np.intp]],
    residuals: Sequence[Array],
    counted: Sequence[npt.NDArray[np.bool_]] | None = None,
) -> Array:
    """Return the squared residuals (B, n) of each block of each bag, for each joint.

    Parameters
    ----------
    blocks : sequence of (M,) ndarray of int
        `Samples.block` of each bag.
    residuals : sequence of (M, n) ndarray
        Torque residuals of each bag [Nm]; NaN is ignored.
    counted : sequence of (M, n) ndarray of bool, optional
        Residuals to include; by default all that are not NaN.
    """
    sums = []
    for index, (block, residual) in enumerate(zip(blocks, residuals, strict=True)):
        counts = np.isfinite(residual) if counted is None else counted[index]
        squares = np.where(counts, residual, 0.0) ** 2
        sums += [np.column_stack([np.bincount(block, own, BLOCKS) for own in squares.T])]
    return np.concatenate(sums)


def standard_errors(differences: Array) -> float:
    """Return the sum of independent differences divided by the standard error of this sum."""
    error = float(differences.std() * np.sqrt(len(differences)))
    return float(differences.sum()) / error if error > 0.0 else 0.0


SIMPLE_TERMS = (
    JointTerm(TermKind.VISCOUS),
    JointTerm(TermKind.COULOMB),
    ROTOR,
    JointTerm(TermKind.OFFSET),
)
"""Terms of every joint in the simple torque model."""

# Relative torque residual of such a simple model, and number of neighbouring samples per
# independent sample; both weight the data against the prior.
_NOISE = 0.03
_CORRELATION = 20.0


class SimpleFit:
    """Fits of links, friction as in thesis (2.6), rotors and offsets; each fit omits one part.

    Parameters
    ----------
    cad : ArmParameters
        CAD parameters, used as a prior for parameters that the motion does not determine.
    shared : sequence of (M, n, k) arrays
        Additional columns of each bag, low-pass filtered like the measured torque; all joints
        share their coefficients. Empty for none.
    spread : float
        Prior standard deviation of these coefficients about 0.
    terms : sequence of JointTerm
        Terms of every joint.
    inertial : (10 n,) ndarray, optional
        Inertial parameters that determine the load of load-dependent terms.

    Attributes
    ----------
    theta : (p,) ndarray
        Parameters fitted to the whole motion: links, shared columns, then the joints' terms.
    """

    def __init__(
        self,
        bags: Sequence[SampleColumns],
        cad: ArmParameters,
        shared: Sequence[Array] = (),
        spread: float = 1.0,
        terms: Sequence[JointTerm] = SIMPLE_TERMS,
        inertial: Array | None = None,
    ) -> None:
        self._bags = bags
        self._terms, self._inertial = tuple(terms), inertial
        self._shared = list(shared) or [bag.rigid[..., :0] for bag in bags]
        more = np.full(self._shared[0].shape[2], spread)
        mean = np.concatenate([cad.inertial.ravel(), np.zeros(len(more))])
        self._common = len(mean)
        gram, right, scale = self._normal_equations()
        scale[: self._common] = [*LINK_SPREAD * cad.inertial_scale().ravel(), *more]
        mean = np.concatenate([mean, np.zeros(len(scale) - len(mean))])
        # The last matrix contains all parts; each other matrix lacks one part.
        gram = np.concatenate([gram.sum(axis=0) - gram, gram.sum(axis=0, keepdims=True)])
        right = np.concatenate([right.sum(axis=0) - right, right.sum(axis=0, keepdims=True)])
        system = gram * np.outer(scale, scale) + np.eye(len(scale))
        wanted = scale * (right - gram @ mean)
        solved = mean + scale * np.linalg.solve(system, wanted[..., None])[..., 0]
        self._parts, self.theta = solved[:-1], solved[-1]

    def deviations(self) -> Array:
        """Return standard deviations (p,) of `theta`, by the jackknife over parts of the motion."""
        spread = self._parts - self._parts.mean(axis=0)
        return np.asarray(np.sqrt((FOLDS - 1) / FOLDS * (spread**2).sum(axis=0)))

    def rates(self) -> list[Array]:
        """Return the time derivative (M, n) of the filtered predicted torque of each bag [Nm/s].

        The prediction includes links and joint terms, but not shared columns.
        """
        n = self._bags[0].samples.n
        own = self.theta[self._common :].reshape(n, -1)
        return [
            bag.samples.coarse_filter(bag.rigid_raw @ self.theta[: 10 * n], derivative=1)
            + sum(bag.rate(term, self._inertial) * own[:, k] for k, term in enumerate(self._terms))
            for bag in self._bags
        ]

    def raw_residuals(self) -> list[Array]:
        """Return recorded minus predicted torque; each predicted part was omitted from the fit.

        The fit uses filtered torque, the residuals use recorded torque. So trials with different
        filters are comparable.

        Returns
        -------
        list of (M, n) ndarray
            Residual torque [Nm]; NaN where torque was not measured.
        """
        columns = [self._raw_columns(bag) for bag in self._bags]
        torques = [bag.samples.tau_raw for bag in self._bags]
        return self._residuals([bag.rigid_raw for bag in self._bags], columns, torques)

    def residuals(self) -> list[Array]:
        """Return residuals of filtered torque [Nm]; the prediction includes shared columns."""
        columns = [self._joint_columns(bag) for bag in self._bags]
        return self._residuals(
            [bag.rigid for bag in self._bags], columns, [bag.samples.tau for bag in self._bags]
        )

    def _normal_equations(self) -> tuple[Array, Array, Array]:
        """Return Gram matrices and torque products per part, and prior standard deviations."""
        n, own = self._bags[0].samples.n, len(self._terms)
        common, size = self._common, self._common + n * own
        gram, right, spread = np.zeros((FOLDS, size, size)), np.zeros((FOLDS, size)), np.ones(size)
        terms = [self._joint_columns(bag) for bag in self._bags]
        for joint in range(n):
            index = np.concatenate([np.arange(common), common + own * joint + np.arange(own)])
            used, fold = [], []
            for bag, more, columns in zip(self._bags, self._shared, terms, strict=True):
                rows = bag.samples.usable[:, joint]
                parts = (bag.rigid, more, columns, bag.samples.tau)
                block = np.column_stack([part[rows, joint] for part in parts])
                used.append(bag.weights[joint] * block)
                fold.append(bag.samples.fold[rows])
            stacked, part_of = np.vstack(used), np.concatenate(fold)
            norms = np.linalg.norm(stacked, axis=0)
            # A prior standard deviation of a joint coefficient would explain all of the joint's
            # torque.
            spread[index[common:]] = norms[-1] / np.maximum(norms[common:-1], 1e-9)
            unit = _NOISE * np.sqrt(_CORRELATION / max(len(stacked), 1)) * max(norms[-1], 1e-9)
            stacked /= unit
            for part in range(FOLDS):
                rows_of_part = stacked[part_of == part]
                product = rows_of_part.T @ rows_of_part
                gram[part][np.ix_(index, index)] += product[:-1, :-1]
                right[part, index] += product[:-1, -1]
        return gram, right, spread

    def _residuals(
        self, links: Sequence[Array], columns: Sequence[Array], torques: Sequence[Array]
    ) -> list[Array]:
        residuals = []
        for bag, rigid, more, own, torque in zip(
            self._bags, links, self._shared, columns, torques, strict=True
        ):
            residual, samples = torque.copy(), bag.samples
            for part, values in enumerate(self._parts):
                rows = samples.fold == part
                inertial, shared, _ = np.split(values, [rigid.shape[2], self._common])
                residual[rows] -= rigid[rows] @ inertial + more[rows] @ shared
                joints = values[self._common :].reshape(samples.n, -1)
                residual[rows] -= (own[rows] * joints).sum(axis=2)
            residuals.append(np.where(samples.measured, residual, np.nan))
        return residuals

    def _joint_columns(self, bag: SampleColumns) -> Array:
        """Return the low-pass filtered columns of the joints' terms, (M, n, k)."""
        return np.stack([bag.term(term, self._inertial) for term in self._terms], axis=2)

    def _raw_columns(self, bag: SampleColumns) -> Array:
        """Return the columns (M, n, k) of the joints' terms, without low-pass filter."""
        samples = bag.samples
        load = None if self._inertial is None else np.abs(bag.links_torque(self._inertial))
        return np.stack([t.basis(samples.dq, samples.ddq, load) for t in self._terms], axis=2)
