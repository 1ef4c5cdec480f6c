"""`flight_control` with control laws that only benchmarks compare with its own.

They are a model of PX4's loops, and estimators of unmodelled forces on the drone: by an observer,
or incrementally (INDI). As a program with the arguments of `flight_control`; `law` selects the
control law.
"""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Protocol

import numpy as np

from aerarm_ros.control.checks import positive
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_control import FlightControl, FlightGains
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import Array, limited
from aerarm_ros.nodes.flight_control import NAME, PARAMETERS, FlightControlNode
from aerarm_ros.ros.flight.flight_parameters import flight_gains
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.process.process_end import die_with_launch

sys.path.append(str(Path(__file__).parents[1]))
from flying.firmware_program import Px4AllGains
from flying.px4_loops import Px4Flight


class Disturbance(Protocol):
    """Interface of an estimator of the unmodelled wrench on drone and arm."""

    def update(self, state: FlightState, body: MassProperties, wrench: Array, dt: float) -> Array:
        """Return the unmodelled wrench (6,): force in the world, moment in body axes.

        The moment is about the centre of mass.

        Parameters
        ----------
        wrench : (6,) ndarray
            Sum of all known wrenches except weight over the last `dt` [s], in body axes about the
            body frame's origin.
        """
        ...


_WEIGHT = np.array([0.0, 0.0, -GRAVITY])


class DisturbanceObserver:
    """Disturbance observer: the change of momentum that known forces do not explain.

    The observer is of first order: `d = K (p - int(w + d) dt)`, with the known wrench w and the
    estimate d. The momentum p is that of drone and arm as one rigid body, from odometry and
    gyroscope.

    Parameters
    ----------
    frequency : float
        Gain K, which is the observer's bandwidth [rad/s].
    """

    def __init__(self, frequency: float) -> None:
        self._gain = positive('observer_frequency', frequency)
        self._expected: Array | None = None
        self._estimate = np.zeros(6)

    def update(self, state: FlightState, body: MassProperties, wrench: Array, dt: float) -> Array:
        """Return the unmodelled wrench (6,), see `Disturbance.update`."""
        spin = body.inertia @ state.rate
        velocity = state.velocity + state.rotation @ cross(state.rate, body.centre)
        momentum = np.concatenate([body.mass * velocity, spin])
        if self._expected is None:
            self._expected = momentum
        known = np.concatenate(
            [
                state.rotation @ wrench[:3] + body.mass * _WEIGHT,
                wrench[3:] - cross(body.centre, wrench[:3]) - cross(state.rate, spin),
            ]
        )
        self._expected = self._expected + dt * (known + self._estimate)
        self._estimate = self._gain * (momentum - self._expected)
        return self._estimate


class IncrementalEstimate:
    """Incremental dynamic inversion (INDI), expressed as an estimator of the disturbance.

    INDI commands `w_f + M (a_wanted - a_f)`. The rotors' wrench w and the measured acceleration a
    pass equal filters (Smeur, Chu and de Croon, J. Guid. Control Dyn. 2016). The command equals `M
    a_wanted - d` with the disturbance `d = M a_f - w_f`, with a second-order filter.

    Parameters
    ----------
    drone : DroneConfig
        Drone with the position of its IMU.
    frequency : float
        Natural frequency of the critically damped filter [rad/s].
    """

    def __init__(self, drone: DroneConfig, frequency: float) -> None:
        self._imu = np.array(drone.imu.position)
        self._frequency = positive('observer_frequency', frequency)
        self._rate: Array | None = None
        self._once = self._twice = np.zeros(6)

    def update(self, state: FlightState, body: MassProperties, wrench: Array, dt: float) -> Array:
        """Return the unmodelled wrench (6,), see `Disturbance.update`."""
        rate, before = state.rate, self._rate
        self._rate = rate
        if before is None or dt <= 0.0 or state.specific_force is None:
            return self._twice
        spin = (rate - before) / dt
        lever = body.centre - self._imu
        felt = state.specific_force + cross(spin, lever)
        felt = felt + cross(rate, cross(rate, lever))
        momentum = body.inertia @ rate
        moment = wrench[3:] - cross(body.centre, wrench[:3])
        disturbance = np.concatenate(
            [
                state.rotation @ (body.mass * felt - wrench[:3]),
                body.inertia @ spin + cross(rate, momentum) - moment,
            ]
        )
        gain = 1.0 - np.exp(-self._frequency * dt)
        self._once = self._once + gain * (disturbance - self._once)
        self._twice = self._twice + gain * (self._once - self._twice)
        return self._twice


class RotorEstimate:
    """Estimate of the rotors' thrusts: each follows its command with a first-order lag."""

    def __init__(self, drone: DroneConfig) -> None:
        self._allocation = drone.allocation
        self._time_constant = drone.column('time_constant')
        self._command: Array | None = None
        self._thrust = np.zeros(drone.n)

    def command(self, thrust: Array) -> None:
        """Set the commanded thrusts (n,) [N]; the first command acts without lag."""
        if self._command is None:
            self._thrust = thrust
        self._command = thrust

    def advance(self, dt: float) -> Array:
        """Return the rotors' mean wrench (6,) over the next `dt` [s], about the body's origin."""
        if self._command is None:
            return np.asarray(self._allocation @ self._thrust)
        before = self._thrust
        gain = 1.0 - np.exp(-dt / self._time_constant)
        self._thrust = before + gain * (self._command - before)
        return np.asarray(self._allocation @ (0.5 * (before + self._thrust)))


_FORCE_MAX, _LEVER_MAX = 4.0, 0.2  # largest estimate: [m/s^2], and moment over the weight [m]


class RejectingFlight:
    """`FlightControl` whose integral action is replaced by an estimate of the unmodelled wrench.

    The controller compensates the estimated force by the target's acceleration, and the estimated
    moment as a moment of the arm's motion.
    """

    def __init__(
        self, drone: DroneConfig, body: MassProperties, gains: FlightGains, estimate: Disturbance
    ) -> None:
        no_integral = replace(gains, position_integral=0.0, attitude_integral=0.0)
        self._control = FlightControl(drone, body, no_integral)
        self._estimate, self._rotors = estimate, RotorEstimate(drone)
        self._at_rest = FeedForward.at_rest(body)
        self._moment_max = _LEVER_MAX * body.mass * GRAVITY
        self.problem = self._control.problem

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the rotors' thrusts (n,) [N], see `FlightControl.update`."""
        arm = self._at_rest if arm is None else arm
        known = self._rotors.advance(dt) + arm.wrench_now
        found = self._estimate.update(state, arm.body, known, dt)
        force = limited(found[:3], _FORCE_MAX * arm.body.mass)
        target = target._replace(acceleration=target.acceleration - force / arm.body.mass)
        moment = np.concatenate([np.zeros(3), limited(found[3:], self._moment_max)])
        arm = arm._replace(wrench=arm.wrench + moment)
        return self._sent(self._control.update(state, target, dt, arm))

    def level(self, state: FlightState, dt: float) -> Array:
        """Return thrusts (n,) [N] for a level descent, used if the position is unknown."""
        self._rotors.advance(dt)
        return self._sent(self._control.level(state, dt))

    def _sent(self, thrusts: Array) -> Array:
        self._rotors.command(thrusts)
        return thrusts


OBSERVER, INDI, PX4_LOOPS = LAWS = 'observer', 'indi', 'px4'


class ComparedFlightProcess(NodeProcess):
    """Process of this program, with the parameter `law` in addition to `flight_control`'s."""

    program = (__file__,)


def compared_law(
    values: SimpleNamespace, drone: DroneConfig, body: MassProperties
) -> RejectingFlight | Px4Flight:
    """Return the control law that the parameter `law` selects."""
    if values.law == PX4_LOOPS:
        if drone.is_fully_actuated:
            raise ValueError('the model of PX4 tilts the drone: use coplanar rotors')
        gains = replace(
            Px4AllGains.scaled(values.mpc_xy_p, values.mc_att_p, values.mc_rate_k),
            mc_yawrate_p=values.mc_yawrate_p,
        )
        return Px4Flight(drone, body, gains, values.tilt_ahead, values.hold_heading)
    frequency = values.observer_frequency
    is_observer = values.law == OBSERVER
    estimate = (
        DisturbanceObserver(frequency) if is_observer else IncrementalEstimate(drone, frequency)
    )
    return RejectingFlight(drone, body, flight_gains(values), estimate)


class ComparedFlightNode(FlightControlNode):
    """The node `flight_control` with one of the compared laws."""

    parameters = ParameterTable(
        *PARAMETERS,
        Parameter('law', OBSERVER, 'control law', choices=LAWS),
        Parameter('mpc_xy_p', 1.5, 'MPC_XY_P', '1/s', 0.1, 5.0),
        Parameter('observer_frequency', 8.0, 'bandwidth of the estimate', 'rad/s', 0.1, 200.0),
    )
    make_law = staticmethod(compared_law)


if __name__ == '__main__':
    die_with_launch()
    del sys.argv[1]  # the name of the executable
    sys.exit(run_node(NAME, ComparedFlightNode, None, ComparedFlightNode.parameters, __doc__))
