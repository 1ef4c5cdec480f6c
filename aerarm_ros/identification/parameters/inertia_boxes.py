"""Homogeneous boxes with the inertia of links, as thesis figure 5.2c draws them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.model.inertia import pseudo_inertia

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InertiaBoxes:
    """A box for each of n links.

    Attributes
    ----------
    centre : (n, 3) ndarray
        Centre of mass in the frame of the link's joint [m].
    axes : (n, 3, 3) ndarray
        Columns: directions of the box's edges, in the same frame.
    half_edges : (n, 3) ndarray
        [m]; NaN where no real body has this inertia.
    """

    centre: Array
    axes: Array
    half_edges: Array

    @property
    def reach(self) -> Array:
        """(n, 3) how far the box reaches from its centre along the frame's axes [m]."""
        return np.asarray((np.abs(self.axes) @ self.half_edges[..., None])[..., 0])

    def corners(self) -> Array:
        """Return the (n, 8, 3) corners in the frames of the links' joints [m]."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        edges = self.axes * self.half_edges[:, None, :]
        return np.asarray(self.centre[:, None, :] + signs @ edges.transpose(0, 2, 1))


def inertia_boxes(inertial: Array) -> InertiaBoxes:
    """Return the boxes that have the mass and inertia of links.

    Parameters
    ----------
    inertial : (n, 10) ndarray
        Of positive masses.
    """
    matter = pseudo_inertia(inertial)
    mass = inertial[:, :1]
    centre = inertial[:, 1:4] / mass
    spread = matter[:, :3, :3] / mass[..., None] - centre[:, :, None] * centre[:, None, :]
    variance, axes = np.linalg.eigh(spread)
    with np.errstate(invalid='ignore'):
        # Homogeneous matter between -a and a has the variance a^2 / 3.
        half_edges = np.sqrt(3.0 * variance)
    return InertiaBoxes(centre, axes, half_edges)
