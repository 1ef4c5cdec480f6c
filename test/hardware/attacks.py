"""Streams of accepted commands that try to damage the arm, by kind.

An attack is a function of a random generator that returns a `Source` for `AttackRig`. The
generator selects directions, amplitudes, frequencies and the attacked joints.
"""

from collections.abc import Callable

import numpy as np
from attack_rig import AttackRig, Offer, Source

Attack = Callable[[np.random.Generator], Source]
NAN = np.nan
# Beyond a limit by less than the margin at which the arm is stopped (`velocity_factor`, ...).
_OVER_SPEED = 1.24
_OVER_EFFORT = 1.99
_OVER_REACH = 0.49  # [rad]
_BEYOND = 0.049  # [rad]


def _signs(random: np.random.Generator) -> np.ndarray:
    return random.choice([-1.0, 1.0], 4)


def _speeds(rig: AttackRig) -> np.ndarray:
    return _OVER_SPEED * rig.config.column('velocity_max')


def _efforts(rig: AttackRig) -> np.ndarray:
    return _OVER_EFFORT * rig.config.column('effort_max')


def _ahead(rig: AttackRig, way: np.ndarray) -> np.ndarray:
    """Return positions as far ahead of the arm as the gate accepts."""
    q = rig.bridge.q + _OVER_REACH * way
    low = rig.config.column('position_min') - _BEYOND
    return np.clip(q, low, rig.config.column('position_max') + _BEYOND)


def velocity(random: np.random.Generator) -> Source:
    """Full speed into the limits, by velocity."""
    way = _signs(random)
    return lambda rig: Offer(velocity=way * _speeds(rig))


def position(random: np.random.Generator) -> Source:
    """Position references far ahead, up to beyond the limits."""
    way = _signs(random)
    return lambda rig: Offer(position=_ahead(rig, way))


def position_velocity(random: np.random.Generator) -> Source:
    """Positions far ahead, with the corresponding velocity."""
    way = _signs(random)
    return lambda rig: Offer(_ahead(rig, way), way * _speeds(rig))


def full_law(random: np.random.Generator) -> Source:
    """Position, velocity and effort, all in one direction."""
    way = _signs(random)
    return lambda rig: Offer(_ahead(rig, way), way * _speeds(rig), way * _efforts(rig))


def effort(random: np.random.Generator) -> Source:
    """Full torque in one direction."""
    way = _signs(random)
    return lambda rig: Offer(effort=way * _efforts(rig))


def effort_against_reference(random: np.random.Generator) -> Source:
    """A feedforward effort against a constant position reference."""
    way, held = _signs(random), []

    def source(rig: AttackRig) -> Offer:
        if not held:
            held.append(rig.bridge.q.copy())
        return Offer(held[0], np.zeros(4), way * _efforts(rig))

    return source


def velocity_waves(random: np.random.Generator) -> Source:
    """Square waves of velocity near the loop's resonance."""
    way, turn = _signs(random), random.uniform(0.3, 15.0)
    return lambda rig: Offer(
        velocity=way * _speeds(rig) * np.sign(np.sin(2 * np.pi * turn * rig.now))
    )


def effort_waves(random: np.random.Generator) -> Source:
    """Square waves of effort."""
    way, turn = _signs(random), random.uniform(0.3, 30.0)
    return lambda rig: Offer(
        effort=way * _efforts(rig) * np.sign(np.sin(2 * np.pi * turn * rig.now))
    )


def effort_chatter(random: np.random.Generator) -> Source:
    """An effort that changes its sign every few cycles, with a bias to one side."""
    way, every, share = _signs(random), random.integers(1, 12), random.uniform(0.0, 0.5)

    def source(rig: AttackRig) -> Offer:
        flip = 1.0 if rig.cycles // every % 2 else -1.0
        return Offer(effort=_efforts(rig) * np.clip(flip + share * way, -1.0, 1.0))

    return source


def pump(random: np.random.Generator) -> Source:
    """Effort along the motion of each joint, reversed at its limits."""
    way = _signs(random)

    def source(rig: AttackRig) -> Offer:
        dq = rig.bridge.dq
        return Offer(effort=_efforts(rig) * np.where(np.abs(dq) > 0.2, np.sign(dq), way))

    return source


def pump_loop(random: np.random.Generator) -> Source:
    """Velocity references along the motion of each joint, reversed at its limits."""
    way = _signs(random)

    def source(rig: AttackRig) -> Offer:
        dq = rig.bridge.dq
        return Offer(velocity=_speeds(rig) * np.where(np.abs(dq) > 0.1, np.sign(dq), way))

    return source


def alternating(random: np.random.Generator) -> Source:
    """Another mode in each cycle, all in one direction."""
    way, every = _signs(random), random.integers(1, 4)

    def source(rig: AttackRig) -> Offer:
        ahead, fast, strong = _ahead(rig, way), way * _speeds(rig), way * _efforts(rig)
        offers = (
            Offer(velocity=fast),
            Offer(effort=strong),
            Offer(position=ahead),
            Offer(ahead, fast, strong),
            Offer(position=ahead, effort=strong),
            Offer(velocity=fast, effort=strong),
        )
        return offers[rig.cycles // every % len(offers)]

    return source


def any_mode(random: np.random.Generator) -> Source:
    """Each joint in a mode of its own, changed at random times; NaN for unused values."""
    state = {'way': _signs(random), 'mode': random.integers(1, 8, 4)}

    def source(rig: AttackRig) -> Offer:
        if random.random() < 0.01:
            state['way'] = _signs(random)
        if random.random() < 0.05:
            state['mode'] = random.integers(1, 8, 4)
        way, mode = state['way'], state['mode']
        return Offer(
            np.where(mode & 1, _ahead(rig, way), NAN),
            np.where(mode & 2, way * _speeds(rig), NAN),
            np.where(mode & 4, way * _efforts(rig), NAN),
        )

    return source


def random_walk(random: np.random.Generator) -> Source:
    """Efforts and velocities as random walks."""
    level = np.zeros(4)
    by_effort = random.random(4) < 0.5

    def source(rig: AttackRig) -> Offer:
        level[:] = np.clip(level + 0.1 * random.standard_normal(4), -1.0, 1.0)
        return Offer(
            velocity=np.where(by_effort, NAN, level * _speeds(rig)),
            effort=np.where(by_effort, level * _efforts(rig), NAN),
        )

    return source


def stopping(random: np.random.Generator) -> Source:
    """A stream that stops at speed, and returns."""
    inner = random.choice([velocity, position_velocity, effort, full_law])(random)
    on, off = random.uniform(0.05, 0.5), random.uniform(0.02, 0.4)
    return lambda rig: inner(rig) if rig.now % (on + off) < on else None


def violation(random: np.random.Generator) -> Source:
    """At speed, a command so far out that the arm is stopped permanently."""
    inner, after = random.choice([velocity, effort])(random), random.uniform(0.1, 0.8)
    begin = []

    def source(rig: AttackRig) -> Offer:
        begin.append(rig.now)
        return inner(rig) if rig.now - begin[0] < after else Offer(velocity=[99.0] * 4)

    return source


def swinging(random: np.random.Generator) -> Source:
    """Joint 2 is pressed to a limit while the other joints swing as strongly as they can."""
    way, turn = _signs(random)[1], random.uniform(1.0, 12.0)
    by_effort = random.random() < 0.5

    def source(rig: AttackRig) -> Offer:
        wave = np.sign(np.sin(2 * np.pi * turn * rig.now + np.array([0.0, 0.0, 1.0, 2.0])))
        push = way * (_efforts(rig) if by_effort else _speeds(rig))[1]
        speeds, efforts = [NAN] * 4, wave * _efforts(rig)
        (efforts if by_effort else speeds)[1] = push
        if not by_effort:
            efforts[1] = NAN
        return Offer(velocity=speeds, effort=efforts)

    return source


def unloading(random: np.random.Generator) -> Source:
    """Joint 1 spins the stretched arm, which is then pulled in: its inertia falls tenfold."""
    way = _signs(random)[0]
    by_effort = random.random() < 0.5
    still = random.uniform(0.1, 0.4)

    def source(rig: AttackRig) -> Offer:
        raise_arm = 5.0 * np.sign(np.pi / 2 - rig.bridge.q[1]) if rig.cycles > 1e3 * still else 0.0
        first = way * (_efforts(rig) if by_effort else _speeds(rig))[0]
        speeds, efforts = np.array([NAN, raise_arm, 0.0, 0.0]), np.full(4, NAN)
        (efforts if by_effort else speeds)[0] = first
        return Offer(velocity=speeds, effort=efforts)

    return source


def throwing(random: np.random.Generator) -> Source:
    """Joint 2 is driven to a limit while all other joints, at full speed, throw the arm outward."""
    way, by_effort = _signs(random), random.random() < 0.5

    def source(rig: AttackRig) -> Offer:
        speeds, efforts = way * _speeds(rig), np.full(4, NAN)
        if by_effort:
            speeds[1], efforts[1] = NAN, (way * _efforts(rig))[1]
        return Offer(velocity=speeds, effort=efforts)

    return source


def creeping(random: np.random.Generator) -> Source:
    """Slow motion into the limits and beyond."""
    way, slow = _signs(random), random.uniform(0.02, 0.6)
    return lambda rig: Offer(velocity=slow * way)


def limp(random: np.random.Generator) -> Source:
    """Zero torque for some joints, which fall, while others are driven."""
    way, driven = _signs(random), random.random(4) < 0.5

    def source(rig: AttackRig) -> Offer:
        return Offer(
            velocity=np.where(driven, way * _speeds(rig), NAN), effort=np.where(driven, NAN, 0.0)
        )

    return source


def returning(random: np.random.Generator) -> Source:
    """Full speed from one limit to the other, reversed at the last moment."""
    way, at = _signs(random), random.uniform(0.0, 0.6, 4)
    by_effort = random.random(4) < 0.5

    def source(rig: AttackRig) -> Offer:
        q = rig.bridge.q
        near_top = q > rig.config.column('position_max') - at
        near_bottom = q < rig.config.column('position_min') + at
        way[near_top], way[near_bottom] = -1.0, 1.0
        return Offer(
            velocity=np.where(by_effort, NAN, way * _speeds(rig)),
            effort=np.where(by_effort, way * _efforts(rig), NAN),
        )

    return source


ATTACKS: dict[str, Attack] = {
    attack.__name__: attack
    for attack in (
        velocity,
        position,
        position_velocity,
        full_law,
        effort,
        effort_against_reference,
        velocity_waves,
        effort_waves,
        effort_chatter,
        pump,
        pump_loop,
        alternating,
        any_mode,
        random_walk,
        stopping,
        violation,
        swinging,
        unloading,
        throwing,
        creeping,
        limp,
        returning,
    )
}
# Attacks for boards without a feedforward current.
WITHOUT_EFFORT = frozenset(
    attack.__name__
    for attack in (velocity, position, position_velocity, velocity_waves, pump_loop, creeping)
)
