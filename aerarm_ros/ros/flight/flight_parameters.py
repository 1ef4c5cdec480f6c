"""Parameters of the flight controller, and the objects created from them."""

from __future__ import annotations

from types import SimpleNamespace

from aerarm_ros.autopilot.ardupilot import ArduPilotSetPoints, ArduPilotSetup
from aerarm_ros.autopilot.ardupilot_flight import ArduPilotFirmware
from aerarm_ros.autopilot.betaflight_flight import BetaflightFlight, BetaflightLink
from aerarm_ros.autopilot.firmware_flight import FirmwareFlight
from aerarm_ros.autopilot.px4 import (
    SENSORS,
    VISION,
    Px4Gains,
    Px4SetPoints,
    hover_share,
    tilt_ahead,
)
from aerarm_ros.autopilot.px4_flight import Px4Firmware
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import ArmFeedForward, MassProperties
from aerarm_ros.flight.flight_control import FlightControl, FlightGains
from aerarm_ros.ros.parameters.parameter import Parameter, grouped

OWN, PX4_SITL, ARDUPILOT_SITL, BETAFLIGHT = 'own', 'px4_sitl', 'ardupilot_sitl', 'betaflight'
FlightLaw = FlightControl | FirmwareFlight | BetaflightFlight

_GAINS = FlightGains()
_GAIN_ROWS = (
    ('position_frequency', 'bandwidth of the position loop, horizontal', 'rad/s', 0.1, 20),
    ('height_frequency', 'bandwidth of the position loop, vertical', 'rad/s', 0.1, 20),
    ('attitude_frequency', 'bandwidth of the attitude loop', 'rad/s', 1.0, 60),
    ('position_damping', 'damping ratio of the position loop', '', 0.1, 3.0),
    ('attitude_damping', 'damping ratio of the attitude loop', '', 0.1, 3.0),
    ('position_integral', 'integral gain of the position loop, relative to its bandwidth',
     '', 0.0, 1.0),
    ('attitude_integral', 'integral gain of the attitude loop, relative to its bandwidth',
     '', 0.0, 1.0),
    ('speed_max', 'largest velocity towards a set point', 'm/s', 0.01, 20),
    ('tilt_max', 'largest commanded tilt', 'rad', 0.05, 1.2),
)  # fmt: skip
FLIGHT_PARAMETERS = (
    *grouped(
        'Position and attitude control',
        *(Parameter(row[0], getattr(_GAINS, row[0]), *row[1:]) for row in _GAIN_ROWS),
    ),
    *grouped(
        'Control loops of PX4',
        Parameter(
            'loops', OWN, 'control loops of the drone. own: those of this node; px4_sitl, '
                          'ardupilot_sitl, betaflight: the firmware as a program on this computer',
            choices=(OWN, PX4_SITL, ARDUPILOT_SITL, BETAFLIGHT),
        ),
        Parameter(
            'autopilot_instance', 0, 'instance number of the PX4 program (its option -i) or of the '
                'ArduPilot program (its option -I)', '', 0, 250
        ),
        Parameter(
            'autopilot_sensors', VISION, 'source of the position of PX4 or ArduPilot: vision '
                '(odometry) or gps (simulated GPS receiver)', choices=SENSORS,
        ),
        Parameter('mc_att_p', Px4Gains.mc_att_p, "PX4's attitude gains MC_ROLL_P and "
                                                 'MC_PITCH_P', '1/s', 0.5, 30.0),
        Parameter(
            'mc_rate_k', Px4Gains.mc_rate_k, "PX4's angular rate gains MC_ROLLRATE_K and "
                                             'MC_PITCHRATE_K', '', 0.1, 30.0
        ),
        Parameter(
            'mc_yawrate_p', Px4Gains.mc_yawrate_p,
                "PX4's yaw rate gain MC_YAWRATE_P; set a smaller value for tilted rotors, "
                'whose yaw moment is much larger', '', 0.001, 10.0,
        ),
        Parameter(
            'tilt_ahead', True, "whether the drone tilts in advance for the arm's motion, "
                                "computed by inversion of PX4's loops"
        ),
        Parameter(
            'hold_heading', True, 'whether the set points for PX4 contain a heading; if false, '
                                  'their yaw is NaN',
        ),
    ),
    *grouped(
        'Arm feed-forward',
        Parameter('feed_posture', True,
            'whether the node compensates mass, centre of mass and inertia of the arm, which '
            'it receives on arm_inertia', live=True),
        Parameter('feed_motion', True,
            'whether the node compensates the motion of the joints by the wrench that it '
            'receives on base_wrench_motion', live=True),
        Parameter(
            'feed_lead', 0.028, (
                'delay from a sensor sample to the response of the rotors; the preview time '
                '`lead` of base_reaction must be at least 17 ms larger'
            ), 's', 0.0,
            0.08, live=True,
        ),
        Parameter(
            'arm_wait', 0.0, (
                'longest time for which the node waits for a late forecast of base_reaction, '
                'for lockstep on a busy computer. After a timeout the node waits again once a '
                'forecast is on time. Set 0 if the drone would fall while the node waits'
            ), 's', 0.0, 10.0,
        ),
    ),
)  # fmt: skip


def flight_gains(values: SimpleNamespace) -> FlightGains:
    """Return the gains of the position and attitude loops."""
    return FlightGains(**{name: getattr(values, name) for name in vars(_GAINS)})


def flight_control(values: SimpleNamespace, drone: DroneConfig, body: MassProperties) -> FlightLaw:
    """Return the flight controller of drone and arm for the values of `FLIGHT_PARAMETERS`.

    Raises
    ------
    ValueError
        If the firmware cannot fly the drone, or a port is in use.
    """
    if values.loops == PX4_SITL:
        return _px4_firmware(values, drone, body)
    if values.loops == ARDUPILOT_SITL:
        return _ardupilot_firmware(values, drone, body)
    if values.loops == BETAFLIGHT:
        return BetaflightFlight(drone, body, BetaflightLink(), flight_gains(values))
    return FlightControl(drone, body, flight_gains(values))


def _px4_firmware(
    values: SimpleNamespace, drone: DroneConfig, body: MassProperties
) -> FirmwareFlight:
    names = ('mc_att_p', 'mc_rate_k', 'mc_yawrate_p')
    px4 = Px4Gains(**{name: getattr(values, name) for name in names})
    acceleration = tilt_ahead(px4, drone) if values.tilt_ahead else None
    set_points = Px4SetPoints(drone, flight_gains(values), acceleration, values.hold_heading)
    firmware = Px4Firmware.instance(values.autopilot_instance, values.autopilot_sensors)
    return FirmwareFlight(drone, body, firmware, set_points)


def _ardupilot_firmware(
    values: SimpleNamespace, drone: DroneConfig, body: MassProperties
) -> FirmwareFlight:
    setup, number = ArduPilotSetup(), values.autopilot_instance
    hover_share(drone, body)  # checks that ArduPilot can lift the drone
    firmware = ArduPilotFirmware.instance(number, drone, values.autopilot_sensors)
    acceleration = setup.tilt_ahead(drone) if values.tilt_ahead else SetPointAcceleration()
    set_points = ArduPilotSetPoints(setup.loop, acceleration, values.hold_heading)
    return FirmwareFlight(drone, body, firmware, set_points)


def arm_feed_forward(
    values: SimpleNamespace, drone: DroneConfig, body: MassProperties
) -> ArmFeedForward:
    """Return the feedforward of the arm's load for the values of `FLIGHT_PARAMETERS`."""
    return ArmFeedForward(drone, body, values.feed_posture, values.feed_motion, values.feed_lead)
