"""Arms as built, with deviations from their drawing."""

import numpy as np

from aerarm_ros.model.inertia import from_pseudo_inertia, pseudo_inertia


def other_bodies(
    inertial: np.ndarray, random: np.random.Generator, stretch: float, density: float
) -> np.ndarray:
    """Return (n, 10) inertial parameters of links with manufacturing deviations.

    A body whose material is stretched and shifted remains a physical body.

    Parameters
    ----------
    inertial : (n, 10) ndarray
    random : numpy.random.Generator
    stretch, density : float
        Largest relative change; links are shifted by up to a centimetre.
    """
    n = len(inertial)
    change = np.tile(np.eye(4), (n, 1, 1))
    change[:, :3, :3] += stretch * random.uniform(-1.0, 1.0, (n, 3, 3))
    change[:, :3, 3] = 0.01 * random.uniform(-1.0, 1.0, (n, 3))
    factor = random.uniform(1.0 - density, 1.0 + density, (n, 1, 1))
    matter = pseudo_inertia(inertial)
    return from_pseudo_inertia(factor * change @ matter @ change.transpose(0, 2, 1))
