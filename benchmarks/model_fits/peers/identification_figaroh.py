"""FIGAROH's identification on given samples; run by identification_peers.py.

The script follows the flow of FIGAROH's examples without filters: regressor with friction, actuator
inertia and offsets, base parameters by double QR, and least squares. Physical consistency of the
base parameters is not checked. Usage: identification_figaroh.py SAMPLES.npz ARM.urdf
"""

import json
import logging
import sys
import time
from pathlib import Path

import numpy as np
from figaroh.identification.parameter import (
    add_standard_additional_parameters,
    get_standard_parameters,
)
from figaroh.tools.qrdecomposition import double_QR, get_baseIndex
from figaroh.tools.regressor import (
    build_regressor_basic,
    build_regressor_reduced,
    get_index_eliminate,
)
from figaroh.tools.robot import Robot

MODEL = {
    'has_friction': True,
    'has_actuator_inertia': True,
    'has_joint_offset': True,
    'is_joint_torques': True,
    'is_external_wrench': False,
    'force_torque': None,
}


def main() -> None:
    logging.disable(logging.CRITICAL)
    samples, urdf = np.load(sys.argv[1]), sys.argv[2]
    robot = Robot(urdf, str(Path(urdf).parent))
    n = robot.model.nv
    values = {key: np.zeros(n) for key in ('fv', 'fs', 'Ia', 'off', 'offset')}
    config = {**MODEL, 'act_idxv': list(range(n)), **values}

    def regressor(part: str) -> np.ndarray:
        motion = (samples[f'{part}_{field}'] for field in ('q', 'dq', 'ddq'))
        return build_regressor_basic(robot, *motion, config)

    def torque(part: str) -> np.ndarray:
        return samples[f'{part}_tau'].T.ravel()  # joint after joint, as in FIGAROH's regressor

    begin = time.perf_counter()
    standard = get_standard_parameters(robot.model, config)
    standard |= add_standard_additional_parameters(robot.model, config)
    fitted = regressor('fit')
    without, names = get_index_eliminate(fitted, standard, 1e-6)
    reduced = build_regressor_reduced(fitted, without)
    base = double_QR(torque('fit'), reduced, names)
    index, phi = get_baseIndex(reduced, names), np.asarray(base[3])
    seconds = time.perf_counter() - begin
    held = build_regressor_reduced(regressor('held'), without)[:, list(index)]
    tau = torque('held')
    error = np.linalg.norm(held @ phi - tau) / np.linalg.norm(tau)
    print(json.dumps({'error': 100.0 * float(error), 'consistent': False, 'seconds': seconds}))


if __name__ == '__main__':
    main()
