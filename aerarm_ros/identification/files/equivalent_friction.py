"""Viscous and Coulomb friction nearest to a richer model, for formats that know no more."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.files.friction_torque import NO_FRICTION
from aerarm_ros.identification.parameters.joint_term import COUPLED, TermKind
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate

Array = npt.NDArray[np.float64]


def equivalent_friction(
    estimate: Estimate, bags: Sequence[SampleColumns], beside_load: bool = False
) -> tuple[Array, Array]:
    """Return f_v and f_s of thesis (2.6) that come closest to the estimate's friction.

    Least squares over the motion of the bags, neither coefficient negative. For joints whose
    only friction is that of (2.6), these are the estimate's own coefficients.

    Parameters
    ----------
    estimate : Estimate
    bags : sequence of SampleColumns
        The identification bags.
    beside_load : bool
        Whether to leave out what grows with the load, for who knows that as well, and rounds off
        the sign of the velocity about rest, as `FrictionCompensation` does: Coulomb friction that
        is rounded off stays what it is then.

    Returns
    -------
    two (n,) ndarrays
        [Nms/rad], [Nm]
    """
    model = estimate.model
    left_out = {*NO_FRICTION, TermKind.LOAD} if beside_load else NO_FRICTION
    viscous, coulomb = estimate.joint_values('fv'), estimate.joint_values('fs')
    loads = [bag.links_torque(estimate.inertial.ravel()) for bag in bags]
    values = estimate.theta[10 * model.n :]
    for joint in range(model.n):
        own = [
            (term, value)
            for (j, term), value in zip(model.joint_columns, values, strict=True)
            if j == joint and term.kind not in left_out
        ]
        if all(
            term.kind in (TermKind.VISCOUS, TermKind.COULOMB) and (beside_load or not term.width)
            for term, _ in own
        ):
            continue
        velocity, torque = [], []
        for bag, load in zip(bags, loads, strict=True):
            dq, ddq = bag.samples.dq[:, joint], bag.samples.ddq[:, joint]
            parts = [value * term.basis(dq, ddq, np.abs(load[:, joint])) for term, value in own]
            velocity.append(dq)
            torque.append(np.sum(parts, axis=0))
        viscous[joint], coulomb[joint] = _nearest(np.concatenate(velocity), np.concatenate(torque))
    return viscous, coulomb


def unwritten(estimate: Estimate) -> tuple[str, ...]:
    """Return what to know of the estimate's terms that these formats have no place for.

    Not of offsets, which a controller's integral makes up for.
    """
    names = estimate.model.columns[10 * estimate.model.n :]
    pairs = zip(names, estimate.model.joint_columns, strict=True)
    coupled = [name for name, (_, term) in pairs if term.kind in COUPLED]
    if not coupled:
        return ()
    return (
        f'{", ".join(coupled)} are in estimate.yaml only: URDF, MJCF and SDF have no place for a '
        "torque by another joint's motion",
    )


def _nearest(dq: Array, torque: Array) -> tuple[float, float]:
    columns = np.column_stack([dq, np.sign(dq)])
    both, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    if both.min() >= 0.0:
        return float(both[0]), float(both[1])
    # On the border one coefficient is zero and the other fits alone.
    alone = [float(max(c @ torque / max(c @ c, 1e-300), 0.0)) for c in columns.T]
    left = [np.linalg.norm(torque - c * a) for c, a in zip(columns.T, alone, strict=True)]
    return (alone[0], 0.0) if left[0] < left[1] else (0.0, alone[1])
