"""Test runs of a drive with known parameters, by default without noise."""

from math import copysign, cos, sin, tanh

import numpy as np

from aerarm_ros.identification.motor_bench.motor_friction import MotorRun

VISCOUS, COULOMB, LOAD, INERTIA = 0.006, 0.25, 0.03, 0.02
GRAVITY = np.array([0.4, -2.0])


def torque(q, dq, ddq, gravity=GRAVITY, load=LOAD) -> np.ndarray:
    weight = gravity[0] * np.sin(q) + gravity[1] * np.cos(q)
    dry = (COULOMB + load * np.abs(weight)) * np.sign(dq)
    return INERTIA * ddq + VISCOUS * dq + dry + weight


def step(speed: float, noise: float = 0.0, settling: float = 0.0, **options) -> MotorRun:
    """A stroke from -0.8 to 0.8 rad that loses a fraction `settling` of its speed."""
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
    """Motion in both directions with 12 rad/s^2."""
    time = np.arange(0.0, 6.0, 1e-3)
    w = np.pi
    q, dq, ddq = np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)
    return MotorRun(None, time, q, dq, torque(q, dq, ddq, **options))


def swings(
    play: float, gravity: tuple[float, float] = (0.1, -0.02), seconds: float = 2.0
) -> MotorRun:
    """Return a motor that follows a sine stiffly, and a link between flanks that only push.

    The motor has 0.0095 kg m^2 and 0.1 Nm of dry friction, the link 0.004 kg m^2.
    """
    rotor, links, step, rate, amplitude = 0.0095, 0.004, 2e-4, 11.0, 0.25
    count = 2.0 * np.pi / 4096 / 27
    random = np.random.default_rng(0)
    q = x = 0.0
    dq = dx = amplitude * rate
    rows = []
    for number in range(round(seconds / step)):
        time = number * step
        wanted = amplitude * sin(rate * time), amplitude * rate * cos(rate * time)
        tau = 40.0 * (wanted[0] - q) + 2.0 * (wanted[1] - dq)
        weight = gravity[0] * sin(x) + gravity[1] * cos(x)
        side, deep = copysign(1.0, x - q), abs(x - q) - 0.5 * play
        flank = -side * max(2e3 * deep + 3.0 * side * (dx - dq), 0.0) if deep > 0.0 else 0.0
        dry = (0.1 + LOAD * abs(flank)) * tanh(dq / 1e-2)
        if number % 5 == 0:
            measured = tau + 0.012 * random.standard_normal()
            rows.append((time, count * np.floor(q / count), dq, measured))
        dq += step * (tau - VISCOUS * dq - dry - flank) / rotor
        dx += step * (flank - weight) / links
        q, x = q + step * dq, x + step * dx
    return MotorRun(None, *np.array(rows).T, swings=True)
