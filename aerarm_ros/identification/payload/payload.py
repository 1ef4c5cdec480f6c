"""A body that the arm carries, as it was identified."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.model.inertia import barycentric_inertia

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Payload:
    """Inertial parameters of a rigid body fixed to the last link.

    Attributes
    ----------
    link : str
        The link that carries it; all coordinates are in the frame of that link's joint.
    inertial : (10,) ndarray
        In the order of thesis (3.3); physically consistent.
    covariance : (10, 10) ndarray
        From the noise of the motion with the payload and from the arm's own uncertainty.
    """

    link: str
    inertial: Array
    covariance: Array

    @property
    def mass(self) -> float:
        """[kg]."""
        return float(self.inertial[0])

    @property
    def centre(self) -> Array:
        """(3,) centre of mass [m]."""
        return np.asarray(self.inertial[1:4] / self.inertial[0])

    @property
    def barycentric_inertia(self) -> Array:
        """(3, 3) inertia about the centre of mass [kg m^2]."""
        return barycentric_inertia(self.inertial)

    @property
    def std(self) -> Array:
        """(10,) standard deviations of `inertial`."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def centre_std(self) -> Array:
        """(3,) standard deviations of `centre`, to first order [m]."""
        slope = np.hstack([-self.centre[:, None], np.eye(3)]) / self.mass
        return np.asarray(np.sqrt(np.diag(slope @ self.covariance[:4, :4] @ slope.T)))
