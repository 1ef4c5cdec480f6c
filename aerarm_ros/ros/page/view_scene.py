"""Three-dimensional picture of the arm from its URDF."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import pinocchio as pin
import viser

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.robot import Robot
from aerarm_ros.description.robot_shapes import load_shapes
from aerarm_ros.motion.signals import Array

_GRID_SIZE = 2.0  # [m]
_CLOSE, _FAR = (1.0, 0.35), (1.5, 1.0)  # distance [1.2 m] and height [m] of the camera
_MIDDLE = 0.4  # point at which the camera looks, as a fraction of the way from base to tool
_TRAIL_COLOR = (30, 120, 230)
_TRAIL_STEP = 2e-3  # [m] travelled by the tool between two points of its path
_TRAIL_WIDTH = 2.0  # pixels
_TRAIL_POINTS = 400


class ViewScene:
    """Draw the moving links of the arm, a grid at the base, and the path of the tool.

    Parameters
    ----------
    server
        Server of the page. The picture's up direction is opposite to gravity.
    robot
        Model of the arm. The picture uses the visual shapes of its URDF, or else the collision
        shapes.
    tool
        Frame whose path is drawn; the last frame of the model by default.

    Raises
    ------
    ValueError
        If a frame is unknown, or a mesh has too many triangles.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, tool: str = '') -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        tool = tool and robot.full_name(tool)
        if tool and not robot.model.existFrame(tool):
            known = ', '.join(frame.name for frame in robot.model.frames)
            raise ValueError(f'frame {tool!r} is not in the URDF: choose one of {known}')
        self._tool = robot.model.getFrameId(tool) if tool else robot.model.nframes - 1
        self._scene = server.scene
        self._prepare(server, robot, self._usual_place(robot))
        self._base = self._scene.add_frame('/arm', show_axes=False)
        self._base_pose = pin.SE3.Identity()
        # Joints are nested, so most of them only need a new angle.
        self._paths = _paths(robot.model)
        self._joints = [self._scene.add_frame(path, show_axes=False) for path in self._paths[1:]]
        for shape in _shapes(robot):
            self._add(shape)
        self._path: deque[Array] = deque(maxlen=_TRAIL_POINTS)
        self._trail = self._scene.add_line_segments(
            '/tool_path',
            np.zeros((1, 2, 3)),
            _TRAIL_COLOR,
            thickness=_TRAIL_WIDTH,
            thickness_units='screen',
        )
        self.update(np.clip(np.zeros(robot.n), robot.position_min, robot.position_max))
        self._path.clear()  # the browser has not shown the arm there

    def update(self, q: Array) -> None:
        """Move the links in the picture to the joint angles `q` (n,) [rad]."""
        pin.forwardKinematics(self._model, self._data, q)
        for handle, placement in zip(self._joints, list(self._data.liMi)[1:], strict=True):
            if not np.array_equal(handle.position, placement.translation):
                handle.position = placement.translation
            handle.wxyz = _wxyz(placement.rotation)
        placed = pin.updateFramePlacement(self._model, self._data, self._tool)
        tool = self._base_pose.act(placed.translation)
        if not self._path or np.linalg.norm(tool - self._path[-1]) > _TRAIL_STEP:
            self._path.append(tool.copy())

    def move_base(self, position: Array, wxyz: Array) -> None:
        """Move the arm's picture: the root link has this position [m] and unit quaternion."""
        self._base.position, self._base.wxyz = position, wxyz
        rotation = pin.Quaternion(*wxyz.tolist()).matrix()
        self._base_pose = pin.SE3(rotation, position)

    def update_path(self) -> None:
        """Draw the path that the tool has travelled."""
        points = np.array(self._path)
        if len(points) > 1:
            self._trail.points = np.stack([points[:-1], points[1:]], axis=1)

    def _usual_place(self, robot: Robot) -> Array:
        """Return the tool's position (3,) [m] if each joint is in the middle of its range."""
        low, high = robot.position_min, robot.position_max
        known = np.isfinite(low) & np.isfinite(high)
        middle = np.zeros(robot.n)
        middle[known] = 0.5 * (low[known] + high[known])
        pin.forwardKinematics(self._model, self._data, middle)
        tool = pin.updateFramePlacement(self._model, self._data, self._tool)
        return np.array(tool.translation)

    def _prepare(self, server: viser.ViserServer, robot: Robot, tool: Array) -> None:
        gravity = np.array(robot.gravity_in_base)
        up = -gravity / np.linalg.norm(gravity) if np.any(gravity) else np.array([0.0, 0.0, 1.0])
        self._scene.set_up_direction(tuple(up))
        self._scene.add_grid('/grid', _GRID_SIZE, _GRID_SIZE, cell_size=0.1, section_size=0.5)
        self._scene.add_frame('/base', axes_length=0.12, axes_radius=0.003)
        # A hanging arm has its drone above.
        distance, height = _CLOSE if tool @ up > 0.0 else _FAR
        server.initial_camera.look_at = tuple(_MIDDLE * tool)
        server.initial_camera.position = tuple(
            _MIDDLE * tool + distance * np.array([0.8, -0.9, 0.0]) + height * up
        )

    def _add(self, shape: pin.GeometryObject) -> None:
        """Add one shape of a link to the scene, as a child of the link's joint."""
        solid, scene = shape.geometry, self._scene
        name = f'{self._paths[shape.parentJoint]}/{shape.name}'
        placed: dict[str, Any] = {
            'wxyz': _wxyz(shape.placement.rotation),
            'position': shape.placement.translation,
            'color': tuple(round(255 * x) for x in shape.meshColor[:3]),
        }
        if isinstance(solid, pin.hppfcl.Box):
            scene.add_box(name, dimensions=tuple(2 * solid.halfSide), **placed)
        elif isinstance(solid, pin.hppfcl.Cylinder):
            scene.add_cylinder(name, radius=solid.radius, height=2 * solid.halfLength, **placed)
        elif isinstance(solid, pin.hppfcl.Sphere):
            scene.add_icosphere(name, radius=solid.radius, **placed)
        elif isinstance(solid, pin.hppfcl.BVHModelBase):
            triangles = [list(solid.tri_indices(k)) for k in range(solid.num_tris)]
            vertices = np.array(solid.vertices()) * shape.meshScale
            scene.add_mesh_simple(name, vertices, np.array(triangles), side='double', **placed)


def _paths(model: pin.Model) -> list[str]:
    """Return the names that base and joints have in viser's scene, in the order of the model."""
    paths = ['/arm']
    for name, parent in zip(list(model.names)[1:], list(model.parents)[1:], strict=True):
        paths.append(f'{paths[parent]}/{name}')
    return paths


def _shapes(robot: Robot) -> list[pin.GeometryObject]:
    """Return the URDF's visual shapes, or its collision shapes if no visual shapes can be loaded.

    If no collision shapes can be loaded either, for example without mesh files, return no shapes.
    """
    for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION):
        try:
            found = load_shapes(robot, kind)
        except DescriptionError:
            raise
        except (ValueError, RuntimeError):
            continue
        if len(found.geometryObjects):
            return list(found.geometryObjects)
    return []


def _wxyz(rotation: Array) -> Array:
    """Convert a rotation matrix to a unit quaternion, real part first."""
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)
