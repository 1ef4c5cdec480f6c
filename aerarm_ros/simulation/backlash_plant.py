"""Simulated arm with backlash in its gears."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import Array
from aerarm_ros.simulation.arm_plant import (
    SUBSTEP,
    ArmPlant,
    PlantError,
    PlantParameters,
    bare_urdf,
    copy_settings,
)

# Tooth flanks are stiff: their elastic deflection is much smaller than the backlash.
_FLANK_SOLREF = (4.0 * SUBSTEP, 1.0)
_FLANK_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
_ROTOR_BODY = 1e-6  # [kg], [kg m^2]; the joint's armature represents its inertia


class BacklashPlant(ArmPlant):
    """Simulated arm (`ArmPlant`) with backlash between motor rotors and links.

    Rotor and link of a joint move independently, within `backlash` of each other. At either end of
    the backlash the gear transmits torque. Rotor inertia and all friction are on the rotors' side.
    Position and velocity are those of the rotors, through the gears, as encoders on the motors
    measure them.

    Parameters
    ----------
    robot, parameters, position
        As for `ArmPlant`; the parameters have `backlash`.

    Raises
    ------
    PlantError
        If a backlash is not positive, or the engine rejects the arm.
    """

    def __init__(
        self, robot: Robot, parameters: PlantParameters, position: ArrayLike | None = None
    ) -> None:
        self._play = np.array(parameters.backlash, dtype=float)
        if self._play.shape != (robot.n,) or not (self._play > 0.0).all():
            raise PlantError(
                f'backlash {self._play.tolist()} must be above 0 rad, one for each of '
                f'{", ".join(robot.joint_names)}'
            )
        super().__init__(robot, parameters, position)

    @property
    def backlash(self) -> Array:
        """Copy of the backlash (n,) [rad]: range of each link while its rotor rests."""
        return self._play.copy()

    @property
    def link_position(self) -> Array:
        """Copy of the link angles (n,) [rad], which differ from the rotor angles."""
        return np.array(self._data.qpos[: self.n])

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set rotors and links to joint angles (n,) [rad], centred in the backlash."""
        super().reset(position, velocity)
        self._data.qpos[: self.n] = position
        self._data.qvel[: self.n] = 0.0 if velocity is None else velocity
        mujoco.mj_forward(self._model, self._data)
        self._set_friction()

    def _engine_model(self, robot: Robot) -> Any:
        fixed = super()._engine_model(robot)
        spec = mujoco.MjSpec.from_string(bare_urdf(robot, self.parameters))
        for name in robot.joint_names:
            inertia = [_ROTOR_BODY] * 3
            body = spec.worldbody.add_body(
                name=f'rotor of {name}', mass=_ROTOR_BODY, inertia=inertia, explicitinertial=True
            )
            body.add_joint(name=f'rotor of {name}', type=mujoco.mjtJoint.mjJNT_HINGE)
            tendon = spec.add_tendon(name=name, limited=True, range=[-1.0, 1.0])
            tendon.wrap_joint(name, 1.0)
            tendon.wrap_joint(f'rotor of {name}', -1.0)
        model = spec.compile()
        copy_settings(fixed, model, slice(self.n, None), slice(None, self.n))
        model.tendon_solref_lim[:] = _FLANK_SOLREF
        model.tendon_solimp_lim[:] = _FLANK_SOLIMP
        self._set_play(model)
        return model

    def _last_link(self) -> int:
        return int(self._model.jnt_bodyid[self.n - 1])

    def _set_play(self, model: Any) -> None:
        model.tendon_range[:, 0] = -0.5 * self._play
        model.tendon_range[:, 1] = 0.5 * self._play

    def _set_friction(self) -> None:
        """Update the dry friction, which depends on the torque that the tooth flanks transmit."""
        coulomb = np.array([row[2] for row in self._constants])
        self._load[:] = self._data.qfrc_constraint[: self.n]
        limit = coulomb + self.parameters.load_friction * np.abs(self._load)
        self._friction_limit[:] = limit * [self._stribeck(dq) for dq in self._velocity.tolist()]
