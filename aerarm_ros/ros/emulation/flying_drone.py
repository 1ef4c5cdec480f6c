"""ROS topics of an emulated drone or moving base: rotor commands, IMU and odometry."""

from __future__ import annotations

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
from aerarm_ros.description.drone_urdf import BODY_LINK, IMU_LINK
from aerarm_ros.hardware.bridge_modes import HELD
from aerarm_ros.hardware.emulation.emulated_transport import AnswerWatch
from aerarm_ros.ros.bridge.bridge_diagnostics import Status
from aerarm_ros.ros.diagnostics import Rejections
from aerarm_ros.ros.messages import fill, imu_message, odometry_message
from aerarm_ros.ros.states.flight_stream import RotorCommands
from aerarm_ros.ros.states.state_stream import base_header
from aerarm_ros.simulation.flying_plant import FlyingPlant, FreeBasePlant, MovingBasePlant
from aerarm_ros.simulation.sensors import DelayedSensor, ImuReading, OdometryReading


class EmulatedDrone:
    """Start the motion of the arm's base once the motors hold the arm; publish the base's IMU.

    Parameters
    ----------
    node
        Owner of the publisher.
    plant
        Simulated arm on its base.
    imu
        IMU on the base.
    imu_frame
        Frame name of the IMU.
    """

    def __init__(
        self, node: Node, plant: FreeBasePlant, imu: DelayedSensor[ImuReading], imu_frame: str
    ) -> None:
        self._node = node
        self._plant = plant
        self._imu = imu
        self._publisher = topics.IMU.publisher(node)
        self._imu_frame = imu_frame
        self._is_moving = False

    def update(self, mode: str, stamp_ns: int) -> None:
        """Start the base's motion if the arm's mode permits; publish an IMU sample if due."""
        if not self._is_moving and mode in HELD:
            self._is_moving = True
            if isinstance(self._plant, MovingBasePlant):
                self._plant.start()
        sample = self._imu.update(stamp_ns)
        if sample is not None:
            stamp_ns, reading = sample
            self._publisher.publish(imu_message(base_header(stamp_ns, self._imu_frame), *reading))

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)


WORLD_FRAME = 'odom'


class FlyingDrone(EmulatedDrone):
    """Pass rotor commands to the simulated drone, and publish its sensors.

    The class also tracks which odometry messages a flight controller has answered by a command.

    Parameters
    ----------
    node
        Owner of publishers and subscription.
    plant
        Simulated arm and drone.
    imu, odometry
        Sensors of the drone.
    lag
        Largest number of odometry messages without an answer, see `AnswerWatch`.
    prefix
        Prefix of the frame names.
    others
        Topics and sensors of further odometry; the simulation does not wait for answers to it.
    """

    def __init__(
        self,
        node: Node,
        plant: FlyingPlant,
        imu: DelayedSensor[ImuReading],
        odometry: DelayedSensor[OdometryReading],
        lag: int,
        prefix: str = '',
        others: Sequence[tuple[Topic, DelayedSensor[OdometryReading]]] = (),
    ) -> None:
        super().__init__(node, plant, imu, prefix + IMU_LINK)
        self._flight = plant
        self._odometry = odometry
        self._odometry_publisher = topics.ODOMETRY.publisher(node)
        self._odometry_message = Odometry()
        self._frames = prefix + WORLD_FRAME, prefix + BODY_LINK
        self._published_ns = 0
        self._others = [(topic.publisher(node), sensor) for topic, sensor in others]
        self._wall_forces = None
        if plant.wall is not None:
            self._wall_forces = topics.TRUE_WALL_FORCE.publisher(node)
        self._rejections = Rejections(node)
        self._commands = RotorCommands(node, plant.drone.rotor_names, self._rejections.add)
        self._watch = AnswerWatch(odometry.period_ns, lag)

    @property
    def is_flying(self) -> bool:
        """Whether the drone flies, because the simulation no longer supports it."""
        return not self._flight.is_held

    @property
    def expects(self) -> bool:
        """Whether a flight controller answers the odometry with rotor commands."""
        return self._watch.expects

    def describe(self) -> Status:
        """Return the drone's status for /diagnostics."""
        rotors, is_commanded = self._flight.rotors, self._flight.rotors.is_commanded
        level, text = DiagnosticStatus.OK, 'flying'
        if not self.is_flying:
            text = (
                'the drone is supported until the motors hold the arm and the rotors lift the drone'
                if is_commanded
                else 'the drone is supported, because no rotor_command arrives: start '
                'flight_control'
            )
        elif not is_commanded:
            level = DiagnosticStatus.WARN
            text = 'no rotor commands arrive, so the rotors stop and the drone falls'
        if self._rejections.recent:
            level, text = DiagnosticStatus.WARN, self._rejections.recent
        values: dict[str, object] = {
            f'{name} thrust [N]': f'{thrust:.2f}'
            for name, thrust in zip(self._flight.drone.rotor_names, rotors.thrust, strict=True)
        }
        values['rejected commands'] = self._rejections.count
        return 'drone', level, text, values

    def update(self, mode: str, stamp_ns: int) -> None:
        """Sample the sensors, publish their messages, and apply the newest rotor command."""
        super().update(mode, stamp_ns)
        odometry = self._odometry.update(stamp_ns)
        for publisher, sensor in self._others:
            reading = sensor.update(stamp_ns)
            if reading is not None and publisher.get_subscription_count():
                publisher.publish(self._message(*reading))
        if odometry is not None and self._wall_forces and self._flight.wall:
            message = WrenchStamped(header=base_header(stamp_ns, self._frames[0]))
            fill(message.wrench.force, self._flight.wall.force)
            self._wall_forces.publish(message)
        self.look()
        if odometry is not None:
            self._published_ns = odometry[0]
            self._odometry_message = self._message(*odometry)
            self._odometry_publisher.publish(self._odometry_message)

    def restart(self) -> None:
        """Discard delayed sensor samples, because the arm and the drone were reset."""
        self._published_ns = 0
        self._imu.restart()
        self._odometry.restart()
        for _, sensor in self._others:
            sensor.restart()

    def is_behind(self) -> bool:
        """Return whether the simulation must wait for a rotor command that answers odometry."""
        if not self._watch.awaits(self._published_ns):
            return False
        if self._commands.reader.publishers() == 0:
            self._watch.forget()  # the flight controller has ended
        return self._watch.expects

    def give_up(self) -> None:
        """Do not wait for answers to odometry until the next answer arrives."""
        self._watch.give_up()

    def wait(self, timeout: float) -> None:
        """Wait up to `timeout` [s] for a rotor command."""
        self._commands.reader.wait(timeout)

    def look(self) -> None:
        """Apply the newest rotor command, if a new one has arrived."""
        command = self._commands.newest()
        if command is None:
            return
        stamp_ns, thrust = command
        self._watch.note(stamp_ns, self._published_ns)
        self._flight.rotors.command(thrust)

    def republish(self) -> None:
        """Publish the last odometry again, for late subscribers."""
        if self._published_ns:
            self._odometry_publisher.publish(self._odometry_message)

    def destroy(self) -> None:
        """Destroy the publishers and the subscription."""
        super().destroy()
        others = [other for other, _ in self._others]
        if self._wall_forces:
            others.append(self._wall_forces)
        for publisher in (self._odometry_publisher, *others):
            self._node.destroy_publisher(publisher)
        self._commands.destroy()

    def _message(self, stamp_ns: int, reading: OdometryReading) -> Odometry:
        world, body = self._frames
        return odometry_message(base_header(stamp_ns, world), body, *reading)
