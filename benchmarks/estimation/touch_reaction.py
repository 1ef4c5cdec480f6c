"""Time from contact to reaction, and contact force, for each reaction of a controller to contact.

The emulated arm under computed torque (host feedback, identified model) moves its tool into a wall
at three speeds. The walls are springs with the stiffness of parts of the human body in ISO/TS 15066
(2016, table A.3): 75 N/mm for hands, fingers and the face, 10 N/mm for the abdomen. As in this
standard, the force counts as transient in the first 0.5 s of the contact and as quasi-static
afterwards. The benchmark samples the force at 4 kHz without a filter. The controller receives the
detected contact one cycle after the joint state from which it was detected.
"""

import argparse
import sys
from typing import NamedTuple

import numpy as np
from payload_hours import CYCLE, Arm
from touching.touched_arm import Learnt, Sensors, TouchedPlant, controller, learn, made

from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.contact_reaction import ContactReaction
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Reaction
from aerarm_ros.online.contact_detector import ContactDetector
from aerarm_ros.simulation.arm_plant import SUBSTEP, PlantParameters
from aerarm_ros.simulation.wall import Wall, WallParameters

GAIN = 60.0  # [1/s] of the detector's observer
WALLS = {'stiff': 75e3, 'soft': 10e3}  # [N/m]
DAMPING_RATIO = 0.05  # of a wall and a tool of 0.5 kg
SPEEDS = (0.1, 0.25, 0.5)  # [m/s]
START, END = np.array([-0.6, 0.9, -0.3, 0.6]), np.array([0.6, 1.3, 0.3, 0.9])
TRANSIENT, WATCHED = 0.5, 1.5  # [s] after the touch

Array = np.ndarray


class WalledPlant(TouchedPlant):
    """Simulated arm, and a wall that acts on its tool like a spring."""

    def build_wall(self, place: Array, normal: Array, stiffness: float) -> None:
        """Place a wall of a stiffness [N/m] at a point (3,) [m]; the normal (3,) points into it."""
        damping = 2.0 * DAMPING_RATIO * np.sqrt(0.5 * stiffness)
        self._wall = Wall(WallParameters(tuple(place), tuple(normal), stiffness, damping, 0.0))
        self._tool = self.end_of(self.bodies - 1)
        self.peak = 0.0

    def cycle(self, effort: Array) -> None:
        """Advance by a cycle; `peak` becomes the largest wall force [N] during the cycle."""
        self.apply_effort(effort)
        body, self.peak = self.bodies - 1, 0.0
        for _ in range(round(CYCLE / SUBSTEP)):
            force = self._wall.update(self.place(body, self._tool), SUBSTEP)
            self.peak = max(self.peak, float(np.linalg.norm(force)))
            self.touch(body, self._tool, force)
            self.step()


class Impact(NamedTuple):
    """Times [s] of detection and braking after the contact (NaN if never), and forces [N]."""

    detected: float
    slower: float  # the tool's reference has lost a tenth of its speed
    transient: float
    lasting: float  # largest from 0.5 s on


class Controlled:
    """Arm under computed torque with contact detector and reaction, which moves into a wall."""

    def __init__(self, arm: Arm, truth: PlantParameters, learnt: Learnt) -> None:
        self.limits = JointLimits.from_config(load_arm_config())
        self.follower = TrajectoryFollower(self.limits, FollowerTolerances.uniform(4))
        viscous, coulomb, share = learnt.model.friction
        friction = FrictionCompensation(viscous, coulomb, load_share=share)
        self.loop, law = controller(learnt.model, self.follower, friction, 0.2)
        self.reacts = ContactReaction(self.follower, self.loop, law)
        self.plant = WalledPlant(arm.robot, truth, START)
        self._sensors = Sensors(arm, START, np.random.default_rng(0))
        self._detector = ContactDetector(learnt.external(), learnt.bound, learnt.settings)
        self._state = self._sensors.measure(START, np.zeros(4))
        self._effort = np.zeros(4)
        self.now, self.known = 0.0, False

    def cycle(self) -> None:
        """Run one cycle of control, detection and simulation.

        The controller receives the contact that was detected in the previous cycle.
        """
        self.reacts.report(self.known, self.now)
        self.reacts.update(self._state.q, self.now)
        command = self.loop.update(self._state, self.now)
        if command is not None and command.tau is not None:
            self._effort = command.tau
        report = self._detector.update(self._state, self.now)
        self.known = self.known if report is None else report.in_contact
        self.plant.cycle(self._effort)
        self.now += CYCLE
        self._state = self._sensors.measure(self.plant.position, self._effort)

    @property
    def pace(self) -> float:
        """Speed of the reference [rad/s]."""
        return float(np.linalg.norm(self.follower.reference.dq))


def impact(
    setup: tuple[Arm, PlantParameters, Learnt], reaction: Reaction, speed: float, stiffness: float
) -> Impact:
    """Move the tool into a wall."""
    run, kinematics = Controlled(*setup), Kinematics(setup[0].robot, 'tool0')
    middle = 0.5 * (START + END)
    way = kinematics.jacobian(middle)[:3] @ (END - START)
    # A quintic from rest to rest passes its middle 1.875 times as fast as on average.
    seconds = 1.875 * float(np.linalg.norm(way)) / speed
    run.reacts.reaction = reaction
    run.plant.build_wall(kinematics.position(middle), way / np.linalg.norm(way), stiffness)
    while run.now < 0.3:
        run.cycle()
    run.follower.follow(JointTrajectory(run.limits, run.limits.names, [seconds], [END]), run.now)
    while run.plant.peak == 0.0:
        run.cycle()
        if run.now > 0.4 + seconds:
            raise SystemExit('the tool does not meet the wall')
    touched, pace, peaks = run.now - CYCLE, run.pace, [run.plant.peak]
    detected = slower = np.nan
    while run.now < touched + WATCHED:
        run.cycle()
        peaks.append(run.plant.peak)
        if run.known and np.isnan(detected):
            detected = run.now - CYCLE - touched
        if run.pace < 0.9 * pace and np.isnan(slower):
            slower = run.now - CYCLE - touched
    first = round(TRANSIENT / CYCLE)
    return Impact(detected, slower, max(peaks[:first]), max(peaks[first:]))


def main() -> int:
    """Run all impacts and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seed', type=int, default=1, help='seed of the emulated arm')
    options = parser.parse_args()
    arm, truth = made(4, options.seed)
    setup = arm, truth, learn(arm, truth, options.seed, GAIN)
    print(
        '| stiffness of the wall | tool speed | reaction | contact detected after '
        '| braking after | largest force in the first 0.5 s | largest force after 0.5 s |'
    )
    print('|---|---|---|---|---|---|---|')
    for wall, stiffness in WALLS.items():
        for speed in SPEEDS:
            for reaction in Reaction:
                met = impact(setup, reaction, speed, stiffness)
                print(
                    f'| {wall} | {speed:g} m/s | {reaction.value} | {1e3 * met.detected:.0f} ms | '
                    f'{1e3 * met.slower:.0f} ms | {met.transient:.0f} N | {met.lasting:.1f} N |',
                    flush=True,
                )
    return 0


if __name__ == '__main__':
    sys.exit(main())
