"""`flight_control` with control laws that only benchmarks compare with its own.

As a program with the arguments of `flight_control`; `law` selects the control law.
"""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import MassProperties
from aerarm_ros.nodes.flight_control import NAME, PARAMETERS, FlightControlNode
from aerarm_ros.ros.flight.flight_parameters import flight_gains
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.process.process_end import die_with_launch

sys.path.append(str(Path(__file__).parents[1]))
from flying.px4_loops import Px4Flight
from flying.px4_program import Px4AllGains
from flying.rejection import DisturbanceObserver, IncrementalEstimate, RejectingFlight

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
