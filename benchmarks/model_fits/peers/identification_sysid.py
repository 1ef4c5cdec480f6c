"""MuJoCo's system identification on given samples; run by identification_peers.py.

The parameters are pseudo-inertias (log-Cholesky), which are physically consistent by construction,
and the optimizer is MuJoCo's. The residual is the torque error of MuJoCo's inverse dynamics, plus
rotor inertia, viscous and Coulomb friction of each joint as in the thesis. Usage:
identification_sysid.py SAMPLES.npz ARM.urdf
"""

import json
import sys
import time

import mujoco
import numpy as np
from mujoco import sysid
from mujoco.sysid._src.model_modifier import pi_from_theta

ROWS = 150  # samples to fit, because each costs one inverse dynamics per parameter
FRICTION = ('Ja', 'fv', 'fs')


class Problem:
    """Torque error as a function of the toolbox's parameters."""

    def __init__(self, urdf: str, joints: list[str]) -> None:
        spec = mujoco.MjSpec.from_file(urdf)
        spec.compile()
        # Bodies behind fixed joints are fused in the compiled model.
        self.spec = mujoco.MjSpec.from_string(spec.to_xml())
        self.spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.model = self.spec.compile()
        self.order = [self.model.joint(name).dofadr[0] for name in joints]
        self.bodies = [self.model.body(self.model.joint(name).bodyid[0]).name for name in joints]

    def _apply(self, theta: np.ndarray, body: str) -> None:
        """Set the inertia of a body from the toolbox's ten parameters.

        The toolbox's own modifier works on the specification, which would have to be compiled for
        every body and trial.
        """
        pi = pi_from_theta(theta).ravel()
        mass, centre = pi[0], pi[1:4] / pi[0]
        about_centre = pi[4:].reshape(3, 3) - mass * (
            centre @ centre * np.eye(3) - np.outer(centre, centre)
        )
        moments, axes = np.linalg.eigh(about_centre)
        axes *= np.sign(np.linalg.det(axes))
        k = self.model.body(body).id
        self.model.body_mass[k], self.model.body_ipos[k] = mass, centre
        self.model.body_inertia[k] = moments
        mujoco.mju_mat2Quat(self.model.body_iquat[k], axes.ravel())

    def parameters(self, tau: np.ndarray) -> sysid.ParameterDict:
        """Return nominal pseudo-inertias, and the joints' coefficients."""
        parameters = sysid.ParameterDict()
        for body in self.bodies:
            parameters.add(
                sysid.body_inertia_param(
                    self.spec, self.model, body, inertia_type=sysid.InertiaType.Pseudo
                )
            )
        size = np.abs(tau).max(axis=0)
        for name in FRICTION:
            parameters.add(sysid.Parameter(name, 0.02 * size, np.zeros(len(size)), size))
        return parameters

    def torque(self, parameters, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Return the torques (M, n) [Nm] of a motion."""
        model = self.model
        for body in self.bodies:
            self._apply(parameters[f'{body}_inertia'].value, body)
        data = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        links = np.empty_like(q)
        for k in range(len(q)):
            data.qpos[self.order], data.qvel[self.order] = q[k], dq[k]
            data.qacc[self.order] = ddq[k]
            mujoco.mj_inverse(model, data)
            links[k] = data.qfrc_inverse[self.order]
        rotor, viscous, coulomb = (parameters[name].value for name in FRICTION)
        return links + rotor * ddq + viscous * dq + coulomb * np.sign(dq)


def main() -> None:
    samples, urdf = np.load(sys.argv[1]), sys.argv[2]
    fit, held = (
        [samples[f'{part}_{field}'] for field in ('q', 'dq', 'ddq', 'tau')]
        for part in ('fit', 'held')
    )
    problem = Problem(urdf, samples['joints'].tolist())
    parameters = problem.parameters(fit[3])
    few = [values[:: max(1, len(values) // ROWS)] for values in fit]
    weight = 1.0 / np.sqrt(np.mean(few[3] ** 2, axis=0))

    def errors(x, params):
        params.update_from_vector(x)
        return ((problem.torque(params, *few[:3]) - few[3]) * weight).ravel()

    def residual(x, params, **_):
        # The toolbox's finite differences pass many columns at once.
        x = np.asarray(x)
        many = [errors(column, params) for column in x.reshape(len(x), -1).T]
        return [many[0] if x.ndim == 1 else np.column_stack(many)], None, None

    begin = time.perf_counter()
    found, _ = sysid.optimize(parameters, residual, verbose=False, max_iters=60)
    seconds = time.perf_counter() - begin
    error = np.linalg.norm(problem.torque(found, *held[:3]) - held[3]) / np.linalg.norm(held[3])
    print(json.dumps({'error': 100.0 * error, 'consistent': True, 'seconds': seconds}))


if __name__ == '__main__':
    main()
