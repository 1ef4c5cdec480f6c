"""One motor of an emulated board."""

from math import exp, pi, sin

from aerarm_ros.description.motor_config import MotorConfig
from aerarm_ros.hardware.emulation.alignment_timing import AlignmentTiming
from aerarm_ros.hardware.emulation.emulated_encoder import EmulatedEncoder
from aerarm_ros.hardware.emulation.emulated_heat import EmulatedHeat

_CURRENT_BANDWIDTH = 2.0 * pi * 1000.0  # [rad/s] of the closed current loop
_TRAVEL_TOLERANCE = 0.3  # of an electrical turn, beyond which the alignment has failed


class EmulatedMotor:
    """Alignment, the law (4.4), current loop and encoder of one motor.

    It is advanced in equal sub-steps. The board writes the references and gains, named as in
    `BoardCommand`, and reads the measurements.

    Attributes
    ----------
    torque_current
        Current that makes torque [A]: the plant multiplies it by the true torque constant.
    delivery
        Share of the target current that the driver delivers.
    ready, alignment_failed
        Result of the alignment.
    heat
        How warm it is.
    """

    def __init__(
        self,
        motor: MotorConfig,
        substep: float,
        alignment: AlignmentTiming,
        zero: float | None = 0.0,
        absolute: bool = False,
        pulse_offset: float = 0.0,
    ) -> None:
        self.encoder = EmulatedEncoder(substep, zero, absolute, pulse_offset)
        self.heat = EmulatedHeat(motor)
        self.position = self.velocity = self.current = 0.0
        self.kp = self.kd = self.integral_gain = 0.0
        self.current_saturation = motor.current_max
        self.compensate_index = False
        self.delivery = 1.0
        self.torque_current = 0.0
        self.target_current = 0.0
        self.ready = False
        self.alignment_failed = False
        self._motor = motor
        self._substep = substep
        self._alignment = alignment
        self._current_gain = 1.0 - exp(-_CURRENT_BANDWIDTH * substep)
        self._enabled = False
        self._aligning_for = 0.0
        self._travel_start = 0.0
        self._integral = 0.0

    @property
    def enabled(self) -> bool:
        """Whether the board drives the motor."""
        return self._enabled

    @property
    def measured_current(self) -> float:
        """Quadrature current [A] in the frame the firmware believes in; 0 while it aligns."""
        return self.torque_current if self.ready else 0.0

    @property
    def quadrature_voltage(self) -> float:
        """Voltage [V] for which (4.1) gives Joule loss plus mechanical power."""
        back_emf = 2.0 / 3.0 * self._motor.torque_constant * self.encoder.velocity
        return self.heat.resistance * self.measured_current + back_emf

    @property
    def power(self) -> float:
        """Electrical power that it takes [W], negative while it brakes."""
        return 1.5 * self.quadrature_voltage * self.measured_current

    def enable(self, enabled: bool) -> None:
        """Drive the motor, after an alignment if it has not been aligned; or stop driving it."""
        if enabled and not self._enabled and not self.ready:
            self._aligning_for = 0.0
        self._enabled = enabled
        self._integral = 0.0 if not enabled else self._integral

    def forget_alignment(self) -> None:
        """Switch off; the next enabling aligns again."""
        self._enabled = self.ready = self.alignment_failed = False
        self._integral = 0.0

    def step(self, angle: float) -> None:
        """Advance by one sub-step at a true motor angle [rad]."""
        encoder = self.encoder
        encoder.sample(angle, self.compensate_index)
        if not self._enabled:
            self.target_current = 0.0
        elif self.ready:
            error = self.position - encoder.position
            target = self.kp * error + self.kd * (self.velocity - encoder.velocity) + self.current
            if self.integral_gain:
                target += self._integrate(error)
            limit = self.current_saturation
            self.target_current = -limit if target < -limit else min(target, limit)
        else:
            self._align(angle)
            return
        target = self.delivery * self.target_current
        self.torque_current += self._current_gain * (target - self.torque_current)

    def _integrate(self, error: float) -> float:
        """Return the integral term of (4.4) [A], held within the saturation."""
        limit = self.current_saturation
        step = self.integral_gain * error * self._substep
        self._integral = min(max(self._integral + step, -limit), limit)
        return self._integral

    def _align(self, angle: float) -> None:
        """Turn a field of known direction and let the rotor, a magnet, follow it."""
        timing, before = self._alignment, self._aligning_for
        self._aligning_for = now = before + self._substep
        if now < timing.forward:
            turn = now / timing.forward
        else:
            turn = max(0.0, 1.0 - (now - timing.forward) / timing.reverse)
        pole_pairs = self._motor.pole_pairs
        current = self.delivery * timing.current
        self.torque_current = current * sin(2.0 * pi * turn - pole_pairs * angle)
        self.target_current = timing.current
        if before < timing.forward <= now:
            self._travel_start = self.encoder.position
        if now >= timing.total:
            electrical_turns = (
                (self._travel_start - self.encoder.position) * pole_pairs / (2.0 * pi)
            )
            self.alignment_failed = abs(electrical_turns - 1.0) > _TRAVEL_TOLERANCE
            self.ready = not self.alignment_failed
            self.torque_current = 0.0
