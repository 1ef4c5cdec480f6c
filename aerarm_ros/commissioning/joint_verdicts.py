"""Evaluation of one joint's measurements: motor, encoder, gear and driver."""

from __future__ import annotations

from math import pi

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.commissioning_probe import REACH, SPEED, ProbeReport

RATIO_TOLERANCE = 0.05
_NOT_TURNED = 0.2  # smallest fraction of a joint's turn that its encoder must count
_ALSO_TURNED = 0.25  # another joint may move by this fraction of the turn
_PULSES_OFF = 2
_RETURN_TOLERANCE = 0.05  # [rad] difference between two placements of the joint by hand
_NOT_DRIVEN = 0.5  # smallest fraction of the requested travel that the driven joint must reach
_DELIVERED = (0.8, 1.2)
# Friction of a real gear relative to the configured one: 30 % spread, and running-in of printed
# gears. The allowance applies to joints with almost no friction.
_FRICTION = (0.3, 2.0)
_FRICTION_ALLOWANCE = 0.05  # [Nm]
_TURN = 2.0 * pi

Findings = list[str]
Measured = dict[str, float]


def turn_findings(
    config: ArmConfig, joint: int, turn: float, report: ProbeReport
) -> tuple[Findings, Measured]:
    """Evaluate the reports on a joint that a person turned while the motors were off.

    Parameters
    ----------
    config
        Configuration of the arm.
    joint
        Number of the joint.
    turn
        Angle by which the person turned the joint [rad], positive in the joint's direction.
    report
        Report of the bridge that covers the whole turn.

    Returns
    -------
    findings
        Problems, each with what to check; empty for a joint that matches its configuration.
    measured
        `reduction`: motor turns per joint turn.
    """
    this, names = config.joints[joint], config.joint_names
    gears = config.column('gear.ratio').tolist()
    turned = [gear * abs(span) / abs(turn) for gear, span in zip(gears, report.span, strict=True)]
    most = max(range(config.n), key=turned.__getitem__)
    if turned[most] < _NOT_TURNED:
        return [
            f'{this.name}: no encoder counted the turn; check that you turned the right joint, '
            f'the encoder cable, and the magnet of {this.motor.name}'
        ], {}
    if most != joint:
        other = config.joints[most]
        return [
            f'{this.name}: the encoder of {other.name} counted this turn; swap the cables, or '
            f'board and channel of {this.name} ({this.board}, {this.channel}) and {other.name} '
            f'({other.board}, {other.channel})'
        ], {}
    findings = []
    carried = [name for i, name in enumerate(names) if i != joint and turned[i] > _ALSO_TURNED]
    if carried:
        findings.append(
            f'{this.name}: {", ".join(carried)} turned as well; hold the other joints still '
            'and repeat'
        )
    travel = report.travel[joint]
    if travel * turn * this.sign < 0.0:
        findings.append(
            f'{this.name}: the encoder counts in the opposite direction to the '
            f'configuration; set sign: {-this.sign}'
        )
    reduction, expected = abs(travel / turn), 1.0 / this.gear.ratio
    off = reduction / expected - 1.0
    if abs(off) > RATIO_TOLERANCE:
        findings.append(
            f'{this.name}: the motor makes {reduction:.2f} turns per turn of the joint, but the '
            f'configuration says {expected:.4g} ({100.0 * off:+.0f} %); correct the gear ratio, '
            'or turn the joint by the requested angle'
        )
    pulses = report.span[joint] / _TURN
    if abs(report.pulses[joint] - pulses) > _PULSES_OFF:
        findings.append(
            f'{this.name}: {report.pulses[joint]} index pulses in {pulses:.1f} motor turns; '
            "check the encoder's index line"
        )
    return findings, {'reduction': reduction}


def return_findings(config: ArmConfig, joint: int, report: ProbeReport) -> Findings:
    """Return the problems of a joint that was turned back; arguments as in `turn_findings`."""
    this = config.joints[joint]
    off = this.gear.ratio * report.travel[joint]
    if abs(off) <= _RETURN_TOLERANCE:
        return []
    return [
        f'{this.name}: after the return to the home configuration, the encoder reads {off:+.3f} '
        'rad off; place '
        'the joint exactly, or check the encoder for lost counts and the gear for slip'
    ]


def drive_findings(config: ArmConfig, joint: int, report: ProbeReport) -> tuple[Findings, Measured]:
    """Evaluate a joint whose motor turned it back and forth; arguments as in `turn_findings`.

    Returns
    -------
    findings
        Problems, each with what to check.
    measured
        `delivered`: ratio of measured to requested current. `friction` and `load`: half the
        difference and half the sum of the joint torques in positive and negative direction [Nm].
    """
    this = config.joints[joint]
    if report.phase != 'done' or len(report.strokes) != 2:
        return [f'{this.name}: the motor was not driven ({report.reason or report.phase})'], {}
    gears = config.column('gear.ratio').tolist()
    way = [gear * span / (2.0 * REACH) for gear, span in zip(gears, report.span, strict=True)]
    others = [
        name for i, name in enumerate(config.joint_names) if i != joint and way[i] > _NOT_DRIVEN
    ]
    up, down = report.strokes
    effort = this.torque_per_ampere
    if way[joint] < _NOT_DRIVEN:
        moved = (
            f'{", ".join(others)} moved instead, check the channels'
            if others
            else f'the joint was blocked at {effort * report.current_max:.2f} Nm, so its '
            'friction is too high, a motor phase is open, or something holds the joint'
        )
        return [f'{this.name}: its motor did not move it; {moved}'], {}
    findings = []
    if others:
        findings.append(f'{this.name}: {", ".join(others)} moved as well; check the motor phases')
    if min(up.speed, -down.speed) < 0.5 * SPEED:
        findings.append(
            f'{this.name}: the joint ran at {up.speed:+.2f} and {down.speed:+.2f} rad/s instead '
            f'of {SPEED:+g} and {-SPEED:+g}; check the direction of its motor'
        )
    measured = {
        'friction': 0.5 * effort * (up.measured - down.measured),
        'load': 0.5 * effort * (up.measured + down.measured),
    }
    requested = up.requested - down.requested
    if requested > 0.0:
        measured['delivered'] = (up.measured - down.measured) / requested
    findings += _driver_findings(this.name, measured)
    expected = this.coulomb + this.viscous * SPEED
    findings += _friction_findings(this.name, measured['friction'], expected)
    return findings, measured


def _driver_findings(name: str, measured: Measured) -> Findings:
    share = measured.get('delivered', 0.0)
    low, high = _DELIVERED
    if low <= share <= high:
        return []
    return [
        f'{name}: the driver delivers {100.0 * share:.0f} % of the requested current; check the '
        "supply voltage, the motor phases, and the board's current measurement"
    ]


def _friction_findings(name: str, friction: float, expected: float) -> Findings:
    low, high = (factor * expected for factor in _FRICTION)
    if low - _FRICTION_ALLOWANCE <= friction <= high + _FRICTION_ALLOWANCE:
        return []
    what = (
        'check the joint for rubbing parts'
        if friction > expected
        else ('check the coupling of the gear to the motor')
    )
    return [
        f'{name}: friction is {friction:.3f} Nm, but the configuration says {expected:.3f} Nm; '
        f'{what}, check torque constant and gear'
    ]


def pulse_offset(
    config: ArmConfig, joint: int, home_angle: float, report: ProbeReport
) -> float | None:
    """Return the motor angle at the index pulses, modulo a turn [rad]; None without a pulse.

    Parameters
    ----------
    home_angle
        Motor angle at the start of the report [rad], relative to the configured offset.
    """
    angle = report.pulse_angle[joint]
    return None if angle is None else (home_angle + angle) % _TURN
