"""Parameters of an arm as its URDF and configuration state them: the CAD model."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import TermKind
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.model.inertia import pseudo_inertia

Array = npt.NDArray[np.float64]

_SMALLEST_SIZE = 0.05  # [m]: no link that a joint carries is smaller


@dataclass(frozen=True, eq=False)
class ArmParameters:
    """Inertial parameters of the links and coefficients of the joints' terms.

    Attributes
    ----------
    inertial : (n, 10) ndarray
        In the order of thesis (3.3).
    viscous, coulomb, rotor_inertia : (n,) ndarray
        [Nms/rad], [Nm], [kg m^2] at the joints.
    load_friction : (n,) ndarray
        Dry friction per torque that the gears pass on [-].
    """

    inertial: Array
    viscous: Array
    coulomb: Array
    rotor_inertia: Array
    load_friction: Array

    @classmethod
    def stated(cls, robot: Robot, config: ArmConfig | None) -> 'ArmParameters':
        """Return what the URDF states and, for the rotors, the configuration.

        Raises
        ------
        IdentificationError
            If the configuration lacks a joint of the URDF.
        """
        rotor_inertia = np.zeros(robot.n)
        if config is not None:
            missing = [name for name in robot.joint_names if name not in config.joint_names]
            if missing:
                raise IdentificationError(
                    f'joints {", ".join(missing)} of the URDF are not in the configuration, which '
                    f'has {", ".join(config.joint_names)}: give --urdf and --config of one arm'
                )
            order = [config.joint_names.index(name) for name in robot.joint_names]
            rotor_inertia = config.column('reflected_inertia')[order]
        return cls(
            np.array(robot.inertial_parameters),
            np.array(robot.viscous),
            np.array(robot.coulomb),
            rotor_inertia,
            np.array(robot.load_friction),
        )

    def vector(self, model: JointModel) -> Array:
        """Return theta in the order of `model.columns`; terms that CAD doesn't know are 0."""
        known = {
            TermKind.VISCOUS: self.viscous,
            TermKind.COULOMB: self.coulomb,
            TermKind.ROTOR: self.rotor_inertia,
            TermKind.LOAD: self.load_friction,
        }
        unknown = np.zeros(model.n)
        joints = [known.get(term.kind, unknown)[joint] for joint, term in model.joint_columns]
        return np.concatenate([self.inertial.ravel(), joints])

    def inertial_scale(self) -> Array:
        """Return the natural size of each inertial parameter.

        Returns
        -------
        (n, 10) ndarray
            m, m l and m l^2 with the link's radius of gyration l about its joint's frame.
        """
        mass = self.inertial[:, :1]
        second_moment = np.trace(pseudo_inertia(self.inertial)[:, :3, :3], axis1=1, axis2=2)
        size = np.sqrt(np.maximum(second_moment[:, None] / mass, _SMALLEST_SIZE**2))
        return np.asarray(
            np.hstack([mass, np.repeat(mass * size, 3, 1), np.repeat(mass * size**2, 6, 1)])
        )
