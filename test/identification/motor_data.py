"""Runs of a drive whose parameters are known, without noise unless asked for."""

import numpy as np

from aerarm_ros.identification.motor_bench.motor_run import MotorRun

VISCOUS, COULOMB, LOAD, INERTIA = 0.006, 0.25, 0.03, 0.02
GRAVITY = np.array([0.4, -2.0])


def torque(q, dq, ddq, gravity=GRAVITY, load=LOAD) -> np.ndarray:
    weight = gravity[0] * np.sin(q) + gravity[1] * np.cos(q)
    dry = (COULOMB + load * np.abs(weight)) * np.sign(dq)
    return INERTIA * ddq + VISCOUS * dq + dry + weight


def step(speed: float, noise: float = 0.0, settling: float = 0.0, **options) -> MotorRun:
    """A stroke from -0.8 to 0.8 rad; it slows down by a share `settling` of its speed."""
    time = np.arange(0.0, 1.6 / abs(speed), 1e-3)
    ddq = np.full(len(time), -settling * speed * abs(speed) / 1.6)
    dq = speed + ddq * time
    q = -0.8 * np.sign(speed) + speed * time + 0.5 * ddq * time**2
    random = np.random.default_rng(round(1e3 * abs(speed)))
    tau = torque(q, dq, ddq, **options) + noise * random.standard_normal(len(time))
    return MotorRun(speed, time, q, dq, tau)


def steps(speeds=(0.2, 0.5, 1.0, 2.0), **options) -> list[MotorRun]:
    return [step(sign * speed, **options) for speed in speeds for sign in (1.0, -1.0)]


def acceleration(**options) -> MotorRun:
    """Forth and back with 12 rad/s^2."""
    time = np.arange(0.0, 6.0, 1e-3)
    w = np.pi
    q, dq, ddq = np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)
    return MotorRun(None, time, q, dq, torque(q, dq, ddq, **options))
