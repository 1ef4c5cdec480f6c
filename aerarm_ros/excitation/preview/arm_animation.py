"""A moving arm in three dimensions, from its collision shapes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance.clearance_checker import ClearanceChecker
from aerarm_ros.excitation.preview.shape_mesh import TriangleMesh, mesh_of_shape
from aerarm_ros.motion.float_array import FloatArray

_COLOURS = ('#444b54', '#d9722e', '#8a8f98', '#d9a62e', '#5b8fb9', '#7fb069', '#b5838d', '#6d597a')


class ArmAnimation:
    """Draws an arm in the postures of a trajectory.

    Parameters
    ----------
    robot : the arm.
    clearance : where its collision shapes come from.
    """

    def __init__(self, robot: Robot, clearance: ClearanceChecker) -> None:
        self._robot = robot
        self._data = robot.model.createData()
        self._bodies = self._merge_by_joint(clearance.shapes)
        self._tool = self._farthest_frame()

    @property
    def tool_name(self) -> str:
        """Name of the frame whose path is drawn: of the last link, farthest from its joint."""
        return str(self._robot.model.frames[self._tool].name)

    def tool_path(self, positions: FloatArray) -> FloatArray:
        """Return the tool's position in the base frame (M, 3) [m] for postures (M, n) [rad]."""
        path = []
        for q in positions:
            pin.framesForwardKinematics(self._robot.model, self._data, q)
            path.append(self._data.oMf[self._tool].translation.copy())
        return np.array(path)

    def figure(self, times: FloatArray, positions: FloatArray, frames: int = 56) -> go.Figure:
        """Return the animation.

        Parameters
        ----------
        times : (M,) [s].
        positions : (M, n) postures [rad].
        frames : pictures of the animation.
        """
        shown = np.unique(np.linspace(0, len(times) - 1, frames).astype(int))
        path = self.tool_path(positions)
        line = go.Scatter3d(
            x=path[:, 0], y=path[:, 1], z=path[:, 2], mode='lines',
            name=f'path of {self.tool_name}',
            line={'width': 2, 'color': '#9db4c0'},
        )  # fmt: skip
        figure = go.Figure(data=[*self._draw(positions[shown[0]]), line])
        bodies = list(range(len(self._bodies)))
        figure.frames = [
            go.Frame(data=self._place(positions[i]), traces=bodies, name=f'{times[i]:.2f}')
            for i in shown
        ]
        figure.update_layout(
            scene=scene(),
            height=680,
            margin={'l': 0, 'r': 20, 't': 20, 'b': 130},
            updatemenus=[_buttons()],
            sliders=[_slider([frame.name for frame in figure.frames])],
        )  # fmt: skip
        return figure

    def _farthest_frame(self) -> int:
        frames = self._robot.model.frames
        last = [
            i
            for i, frame in enumerate(frames)
            if frame.parentJoint == self._robot.n and frame.type == pin.FrameType.BODY
        ]
        return max(last, key=lambda i: float(np.linalg.norm(frames[i].placement.translation)))

    def _draw(self, q: FloatArray) -> list[go.Mesh3d]:
        """Return the links, each whole."""
        meshes = self._place(q)
        for drawn, (joint, mesh) in zip(meshes, self._bodies.items(), strict=True):
            i, j, k = mesh.triangles.astype(np.uint32).T
            colour = _COLOURS[joint % len(_COLOURS)]
            name = self._robot.model.names[joint]
            drawn.update(i=i, j=j, k=k, color=colour, flatshading=True, name=name)
        return meshes

    def _place(self, q: FloatArray) -> list[go.Mesh3d]:
        """Return where the links' corners are: what changes from picture to picture."""
        pin.forwardKinematics(self._robot.model, self._data, q)
        meshes = []
        for joint, mesh in self._bodies.items():
            placement = self._data.oMi[joint]
            # Single precision: enough for a picture, and half of the file's size.
            vertices = mesh.vertices @ placement.rotation.T + placement.translation
            x, y, z = vertices.astype(np.float32).T
            meshes.append(go.Mesh3d(x=x, y=y, z=z))
        return meshes

    @staticmethod
    def _merge_by_joint(shapes: list[pin.GeometryObject]) -> dict[int, TriangleMesh]:
        """Return one mesh for each joint's link, 0 for what is fixed to the base."""
        parts: dict[int, list[TriangleMesh]] = {}
        for shape in shapes:
            mesh = mesh_of_shape(shape)
            if mesh is not None:
                parts.setdefault(shape.parentJoint, []).append(mesh)
        merged = {}
        for joint, meshes in sorted(parts.items()):
            offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
            triangles = [m.triangles + o for m, o in zip(meshes, offsets, strict=False)]
            merged[joint] = TriangleMesh(
                np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles)
            )
        return merged


def scene() -> dict[str, object]:
    """Return the layout of a scene in the base frame that shows all of its axes' box."""
    axes = {f'{axis}axis_title': f'{axis} [m]' for axis in 'xyz'}
    camera = {'eye': {'x': 1.9, 'y': 1.9, 'z': 1.1}, 'center': {'x': 0.0, 'y': 0.0, 'z': -0.12}}
    return {'aspectmode': 'data', 'camera': camera, **axes}


def _buttons() -> dict[str, object]:
    play = {'frame': {'duration': 120, 'redraw': True}, 'fromcurrent': True}
    pause = {'frame': {'duration': 0, 'redraw': False}, 'mode': 'immediate'}
    return {
        'type': 'buttons',
        'direction': 'left',
        'x': 0.13,
        'y': -0.02,
        'yanchor': 'top',
        'buttons': [
            {'label': 'Play', 'method': 'animate', 'args': [None, play]},
            {'label': 'Pause', 'method': 'animate', 'args': [[None], pause]},
        ],
    }


def _slider(names: list[str]) -> dict[str, object]:
    jump = {'frame': {'duration': 0, 'redraw': True}, 'mode': 'immediate'}
    steps = [{'label': name, 'method': 'animate', 'args': [[name], jump]} for name in names]
    return {'currentvalue': {'prefix': 't [s] = '}, 'steps': steps, 'x': 0.15, 'len': 0.85}
