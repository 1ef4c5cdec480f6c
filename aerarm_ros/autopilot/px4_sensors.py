"""Sensor data of a simulated drone, as MAVLink frames for PX4."""

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.mavlink import FrameWriter
from aerarm_ros.autopilot.px4 import GPS, frd_rotation, ned
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

# Origin of the emulated world: latitude, longitude [deg], height [m], and the magnetic field,
# north-east-down [gauss], from PX4's own world model in 2026.
_ORIGIN = 47.397742, 8.545594, 488.0
_FIELD = np.array([0.2152, 0.0120, 0.4306])
_EARTH = 6371000.0  # [m], as in PX4's projection
_IMU_FIELDS, _MAG_FIELDS, _BARO_FIELDS = 0x3F, 0x1C0, 0x1A00
FRAME_LOCAL_NED, FRAME_LOCAL_FRD = 1, 20
"""Values of MAV_FRAME for odometry; PX4 requires the first, ArduPilot the second."""

_FRAME_BODY_FRD, _ESTIMATOR_VISION = 12, 2
_GPS_EVERY, _SLOW_EVERY = 25, 5  # in HIL_SENSOR messages: 10 Hz, 50 Hz
_MAG_NOISE, _PRESSURE_NOISE = 0.002, 0.02  # [gauss], [hPa]
_VARIANCES = (1e-4, 1e-4, 1e-4)  # position [m^2], attitude [rad^2], velocity [m^2/s^2] of vision


class SensorFrames:
    """Encodes sensor data for PX4; emulates magnetometer, barometer and satellite receiver.

    Accelerometer, gyroscope and odometry keep the noise of their input. Magnetometer, barometer and
    satellite receiver get their own noise. PX4 treats equal IMU samples as a sensor fault. The
    samples of a held drone are equal, so `is_held` adds noise to the IMU.

    Parameters
    ----------
    sensors : str
        One of `px4.SENSORS`.
    seed : int
        Seed of the noise.
    gps_noise : tuple of float
        Standard deviations of the GPS receiver's position [m] and velocity [m/s].
    """

    def __init__(
        self,
        writer: FrameWriter,
        sensors: str,
        seed: int = 0,
        gps_noise: tuple[float, float] = (0.02, 0.02),
    ) -> None:
        self._writer = writer
        self._is_gps = sensors == GPS
        self._random = np.random.default_rng(seed)
        self._gps_noise = gps_noise
        self._count = 0
        self._before: FlightState | None = None
        self._before_us = 0

    def frames(
        self, time_us: int, state: FlightState, is_placed: bool = True, is_held: bool = False
    ) -> list[bytes]:
        """Return the sensor messages at `time_us` [us]: position first, then other sensors.

        The position is that of the previous sample, as odometry or, for GPS sensors, as a GPS
        reading in every 25th call. Without `is_placed` the position is left out.
        """
        before = self._before
        frames = []
        if before is not None and is_placed:
            if not self._is_gps:
                frames.append(odometry_frame(self._writer, self._before_us, before))
            elif self._count % _GPS_EVERY == 0:
                frames.append(self._gps(before))
        frames.append(self._sensors(time_us, state, is_held))
        self._before, self._before_us = state, time_us
        self._count += 1
        return frames

    def _noise(self, deviation: float) -> Array:
        return deviation * self._random.standard_normal(3)

    def _sensors(self, time_us: int, state: FlightState, is_held: bool) -> bytes:
        level = GRAVITY * state.rotation[2]
        force = level if state.specific_force is None or is_held else state.specific_force
        rate = np.zeros(3) if is_held else state.rate
        if is_held:
            force, rate = force + self._noise(0.02), rate + self._noise(0.001)
        acceleration, rate = frd_to_flu(force), frd_to_flu(rate)
        values: dict[str, float] = dict(
            zip(('xacc', 'yacc', 'zacc'), acceleration.tolist(), strict=True)
        )
        values.update(zip(('xgyro', 'ygyro', 'zgyro'), rate.tolist(), strict=True))
        fields = _IMU_FIELDS
        if self._count % _SLOW_EVERY == 0:
            field = frd_rotation(state.rotation).T @ _FIELD + self._noise(_MAG_NOISE)
            values.update(zip(('xmag', 'ymag', 'zmag'), field.tolist(), strict=True))
            height = _ORIGIN[2] + float(state.position[2])
            pressure = 1013.25 * (1.0 - 2.25577e-5 * height) ** 5.25588
            values['abs_pressure'] = pressure + float(self._noise(_PRESSURE_NOISE)[0])
            values['pressure_alt'], values['temperature'] = height, 15.0
            fields |= _MAG_FIELDS | _BARO_FIELDS
        return self._writer.pack('HIL_SENSOR', time_usec=time_us, fields_updated=fields, **values)

    def _gps(self, state: FlightState) -> bytes:
        place, speed = self._gps_noise
        north, east, down = (ned(state.position) + self._noise(place)).tolist()
        vn, ve, vd = (100.0 * (ned(state.velocity) + self._noise(speed))).round().astype(int)
        latitude, longitude, height = _ORIGIN
        shrunk = _EARTH * np.cos(np.radians(latitude))
        return self._writer.pack(
            'HIL_GPS', time_usec=self._before_us, fix_type=6,
            lat=round(1e7 * (latitude + np.degrees(north / _EARTH))),
            lon=round(1e7 * (longitude + np.degrees(east / shrunk))),
            alt=round(1e3 * (height - down)), eph=round(100 * max(place, 0.01)),
            epv=round(100 * max(place, 0.01)), vel=int(np.hypot(vn, ve)), vn=int(vn), ve=int(ve),
            vd=int(vd), cog=65535, satellites_visible=20,
        )  # fmt: skip


def odometry_frame(
    writer: FrameWriter, time_us: int, state: FlightState, frame: int = FRAME_LOCAL_NED
) -> bytes:
    """Return an ODOMETRY message: pose in the axes of `frame`, velocity in body axes (FRD)."""
    x, y, z = ned(state.position).tolist()
    qx, qy, qz, qw = pin.Quaternion(frd_rotation(state.rotation)).coeffs().tolist()
    vx, vy, vz = frd_to_flu(state.rotation.T @ state.velocity).tolist()
    p, q, r = frd_to_flu(state.rate).tolist()
    place, turn, speed = _VARIANCES
    return writer.pack(
        'ODOMETRY', time_usec=time_us, frame_id=frame, child_frame_id=_FRAME_BODY_FRD, x=x, y=y,
        z=z, q=(qw, qx, qy, qz), vx=vx, vy=vy, vz=vz, rollspeed=p, pitchspeed=q, yawspeed=r,
        pose_covariance=_diagonal(place, turn), velocity_covariance=_diagonal(speed, speed),
        estimator_type=_ESTIMATOR_VISION, quality=100,
    )  # fmt: skip


def _diagonal(first: float, second: float) -> list[float]:
    """Return the upper triangle (21,) of a diagonal 6 by 6 covariance matrix."""
    rows = np.diag([first] * 3 + [second] * 3)
    return [float(value) for value in rows[np.triu_indices(6)]]
