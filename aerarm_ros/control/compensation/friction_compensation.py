"""Torque against joint friction, without chatter at rest."""

from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import non_negative, positive

Array = npt.NDArray[np.float64]


class FrictionCompensation:
    """Thesis (2.6) with `tanh(dq / width)` for the sign, and the friction of loaded gears.

    A gear loses a share of the torque it passes on, so dry friction is `f_s + f_l |load|`. It
    matters where a load comes and goes with the drone: at 4 % of 1.5 Nm, the first joint's
    friction changes by a quarter of itself.

    Fed with a reference velocity it is exact and free of noise. Fed with a measured one it
    acts, about rest, as a negative damping `fraction * fs / width`: with a fraction below one
    the true friction is still larger at every velocity, so the joint stays passive.

    Parameters
    ----------
    viscous : (n,) array_like
        f_v [Nms/rad]
    coulomb : (n,) array_like
        f_s [Nm]
    width : float
        Velocity [rad/s] at which three quarters of the Coulomb friction are compensated.
    fraction : float
        Part of the friction that is compensated, 0 to 1.
    load_share : float or (n,) array_like
        f_l, dry friction per torque that the gear passes on [-].

    Raises
    ------
    ValueError
        If a coefficient is negative, the width isn't positive or the fraction not in 0 .. 1.
    """

    def __init__(
        self,
        viscous: npt.ArrayLike,
        coulomb: npt.ArrayLike,
        width: float = 0.02,
        fraction: float = 1.0,
        load_share: npt.ArrayLike = 0.0,
    ) -> None:
        n = np.size(viscous)
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f'fraction = {fraction} of the friction must lie in 0 .. 1')
        self._viscous = fraction * non_negative('viscous friction', viscous, n)
        self._coulomb = fraction * non_negative('Coulomb friction', coulomb, n)
        share = fraction * non_negative('load share', load_share, n)
        self._load_share = share if np.any(share) else None
        self._steepness = 1.0 / positive('width', width)

    def torque(self, dq: Array, load: Array | None = None) -> Array:
        """Return the torque [Nm] that keeps velocity `dq` (n,) [rad/s] against friction.

        Parameters
        ----------
        dq : (n,) ndarray
        load : (n,) ndarray, optional
            Torque [Nm] that the gears pass on to the links; none if not given.
        """
        dry: Any = self._coulomb
        if load is not None and self._load_share is not None:
            dry = dry + self._load_share * np.abs(load)
        torque: Array = self._viscous * dq + dry * np.tanh(self._steepness * dq)
        return torque

    def slopes(self, dq: Array, load: Array) -> tuple[Array, Array]:
        """Return how `torque` changes with velocity [Nms/rad] and with load [-].

        Parameters
        ----------
        dq, load : (..., n) ndarray
            As in `torque`.
        """
        sign = np.tanh(self._steepness * dq)
        share: Any = 0.0 if self._load_share is None else self._load_share
        dry = self._coulomb + share * np.abs(load)
        by_velocity: Array = self._viscous + dry * self._steepness * (1.0 - sign**2)
        by_load: Array = share * np.sign(load) * sign
        return by_velocity, by_load
