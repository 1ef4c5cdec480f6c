"""Preview of an excitation trajectory as one HTML page that opens offline."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go
import scipy
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.design_file import write_design
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.trajectory import RampedExcitation
from aerarm_ros.excitation.trajectory_designer import DesignResult, TrajectoryDesigner
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import bullets, origin, page, paragraph, section, table
from aerarm_ros.pages.plots import plotly_figure, plotting_script

_SEGMENTS = 16
_CORNERS = 96  # largest number of corners of a hull


class TriangleMesh(NamedTuple):
    """Triangle mesh of a shape: vertices (V, 3) [m], and triangles (T, 3) of vertex indices."""

    vertices: Array
    triangles: NDArray[np.intp]


def mesh_of_shape(shape: pin.GeometryObject) -> TriangleMesh | None:
    """Return the mesh of a convex shape, in the frame of its link's joint; None for other shapes.

    Parameters
    ----------
    shape : box, cylinder, capsule, sphere or convex hull.
    """
    points = _points(shape.geometry)
    if points is None:
        return None
    hull = scipy.spatial.ConvexHull(points)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    placed = shape.placement
    vertices = points[used] @ placed.rotation.T + placed.translation
    return TriangleMesh(vertices, triangles.reshape(-1, 3))


def _points(geometry: Any) -> Array | None:
    """Return points (P, 3) whose convex hull approximates the shape; circles become polygons."""
    if hasattr(geometry, 'halfSide'):
        corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        return np.asarray(corners * np.asarray(geometry.halfSide))
    if hasattr(geometry, 'points'):
        return _outermost(np.asarray(geometry.points()))
    if not hasattr(geometry, 'radius'):
        return None
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    half = getattr(geometry, 'halfLength', 0.0)
    rounded = geometry.getNodeType() == pin.hppfcl.NODE_TYPE.GEOM_CAPSULE or not half
    latitudes = np.linspace(0.0, 0.5 * np.pi, 4) if rounded else [0.0]
    return np.concatenate(
        [
            np.column_stack(
                [
                    geometry.radius * max(float(np.cos(latitude)), 1e-3) * circle,
                    np.full(len(circle), side * (half + geometry.radius * np.sin(latitude))),
                ]
            )
            for side in (-1.0, 1.0)
            for latitude in latitudes
        ]
    )


def _outermost(points: Array) -> Array:
    """Return the outermost points among (P, 3) points, one for each of many directions.

    A hull of a scanned shape has thousands of corners, and an animation stores each many times.
    """
    if len(points) <= _CORNERS:
        return points
    # Fibonacci sphere: golden angles around, equal steps in height.
    height = 1.0 - (2.0 * np.arange(_CORNERS) + 1.0) / _CORNERS
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_CORNERS)
    ring = np.sqrt(1.0 - height**2)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), height])
    return np.asarray(points[np.unique((points @ directions).argmax(axis=0))])


_COLOURS = ('#444b54', '#d9722e', '#8a8f98', '#d9a62e', '#5b8fb9', '#7fb069', '#b5838d', '#6d597a')


class ArmAnimation:
    """Animation of an arm in the postures of a trajectory.

    Parameters
    ----------
    robot : robot model of the arm.
    clearance : clearance checker with the arm's collision shapes; None for an arm without shapes.
    """

    def __init__(self, robot: Robot, clearance: ClearanceChecker | None) -> None:
        self._robot = robot
        self._data = robot.model.createData()
        self._bodies = self._merge_by_joint([] if clearance is None else clearance.shapes)
        self._tool = self._farthest_frame()

    @property
    def tool_name(self) -> str:
        """Name of the drawn tool frame: of the last link's frames, the farthest from the joint."""
        return str(self._robot.model.frames[self._tool].name)

    def tool_path(self, positions: Array) -> Array:
        """Return the tool's position in the base frame (M, 3) [m] for postures (M, n) [rad]."""
        path = []
        for q in positions:
            pin.framesForwardKinematics(self._robot.model, self._data, q)
            path.append(self._data.oMf[self._tool].translation.copy())
        return np.array(path)

    def figure(self, times: Array, positions: Array) -> go.Figure:
        """Return the animation as a Plotly figure.

        Parameters
        ----------
        times : (M,) times [s].
        positions : (M, n) postures [rad].
        """
        shown = np.unique(np.linspace(0, len(times) - 1, _FRAMES).astype(int))
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
            **playback([frame.name for frame in figure.frames], 120),
        )
        return figure

    def _farthest_frame(self) -> int:
        frames = self._robot.model.frames
        last = [
            i
            for i, frame in enumerate(frames)
            if frame.parentJoint == self._robot.n and frame.type == pin.FrameType.BODY
        ]
        return max(last, key=lambda i: float(np.linalg.norm(frames[i].placement.translation)))

    def _draw(self, q: Array) -> list[go.Mesh3d]:
        """Return Plotly meshes of all links in the posture q, with corners and triangles."""
        meshes = self._place(q)
        for drawn, (joint, mesh) in zip(meshes, self._bodies.items(), strict=True):
            i, j, k = mesh.triangles.astype(np.uint32).T
            colour = _COLOURS[joint % len(_COLOURS)]
            name = self._robot.model.names[joint]
            drawn.update(i=i, j=j, k=k, color=colour, flatshading=True, name=name)
        return meshes

    def _place(self, q: Array) -> list[go.Mesh3d]:
        """Return Plotly meshes of all links in the posture q, with corner positions only."""
        pin.forwardKinematics(self._robot.model, self._data, q)
        meshes = []
        for joint, mesh in self._bodies.items():
            placement = self._data.oMi[joint]
            # Single precision suffices for a picture and halves the file's size.
            vertices = mesh.vertices @ placement.rotation.T + placement.translation
            x, y, z = vertices.astype(np.float32).T
            meshes.append(go.Mesh3d(x=x, y=y, z=z))
        return meshes

    @staticmethod
    def _merge_by_joint(shapes: list[pin.GeometryObject]) -> dict[int, TriangleMesh]:
        """Return one mesh for the link of each joint, by joint number; number 0 is the base."""
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
    """Return the layout of a three-dimensional plot that shows the whole arm in the base frame."""
    axes = {f'{axis}axis_title': f'{axis} [m]' for axis in 'xyz'}
    camera = {'eye': {'x': 1.9, 'y': 1.9, 'z': 1.1}, 'center': {'x': 0.0, 'y': 0.0, 'z': -0.12}}
    return {'aspectmode': 'data', 'camera': camera, **axes}


def playback(names: list[str], milliseconds: int) -> dict[str, object]:
    """Return the layout with buttons and slider of an animation, by the names of its frames."""
    play = {'frame': {'duration': milliseconds, 'redraw': True}, 'fromcurrent': True}
    pause = {'frame': {'duration': 0, 'redraw': False}, 'mode': 'immediate'}
    jump = {'frame': {'duration': 0, 'redraw': True}, 'mode': 'immediate'}
    buttons = [
        {'label': 'Play', 'method': 'animate', 'args': [None, play]},
        {'label': 'Pause', 'method': 'animate', 'args': [[None], pause]},
    ]
    steps = [{'label': name, 'method': 'animate', 'args': [[name], jump]} for name in names]
    place = {'type': 'buttons', 'direction': 'left', 'x': 0.13, 'y': -0.02, 'yanchor': 'top'}
    slider = {'currentvalue': {'prefix': 't [s] = '}, 'steps': steps, 'x': 0.15, 'len': 0.85}
    return {'updatemenus': [{**place, 'buttons': buttons}], 'sliders': [slider]}


_STEP = 0.02
_FRAMES = 56  # of the animation
_LINE_COLOURS = ('#1f77b4', '#d9722e', '#2ca02c', '#9467bd', '#8c564b', '#e377c2', '#17becf')


class Preview:
    """HTML page of a trajectory: plots, workspace, parameter accuracy and animation.

    Parameters
    ----------
    designer : designer with regressor and standard deviations.
    result : trajectory to show.
    reference : trajectory, usually a random one, with which the standard deviations of the
        parameters are compared.
    """

    def __init__(
        self, designer: TrajectoryDesigner, result: DesignResult, reference: DesignResult
    ) -> None:
        self._designer = designer
        self._setup: ExcitationSetup = designer.specification.setup
        self._result = result
        self._reference = reference
        self._animation = ArmAnimation(self._setup.robot, self._setup.clearance)
        motion = RampedExcitation(result.trajectory, 1, self._setup.config.ramp_time)
        self._times: Array = np.arange(0.0, motion.duration, _STEP)
        self._states = motion.evaluate(self._times)

    def write(self, path: Path | str) -> None:
        """Write the preview page to a file.

        Raises
        ------
        ExcitationError
            If the page cannot be written.
        """
        write_design(path, self._page())

    def _page(self) -> str:
        trajectory = (
            'One period of the trajectory, with run-in and run-out. Dashed lines: limits of the '
            'excitation. Click a joint to hide it.'
        )
        workspace = (
            f'Path of {self._animation.tool_name} in the base frame, and the covered fraction of '
            'each joint range.'
        )
        parameters = (
            'Expected standard deviation of the identifiable part of each parameter, after one '
            'period at 1 kHz with white torque noise. Smaller is better. A parameter without a '
            'bar cannot be identified from any motion of this arm.'
        )
        animation = self._animation.figure(self._times, self._states.q)
        sections = [
            ('Trajectory', [self._trajectory()], trajectory),
            ('Workspace', [self._path(), self._coverage()], workspace),
            ('Excitation of each parameter', [self._deviations()], parameters),
            ('Animation', [animation], 'Collision shapes in the postures of the trajectory.'),
        ]
        body: list[str] = [*self._summary()]
        for title, figures, text in sections:
            body.append(section(title, paragraph(text, 'note'), *map(plotly_figure, figures)))
        return page('Excitation trajectory', plotting_script(), body, origin())

    def _summary(self) -> list[str]:
        trajectory, quality = self._result.trajectory, self._result.quality
        other = self._reference.quality
        gain = np.exp(other.log_deviation - quality.log_deviation)
        lead = (
            f'{trajectory.harmonics} harmonics of {trajectory.f0:g} Hz. The condition number of '
            f'the regressor (thesis, equation 5.2) is {quality.condition_number:.1f}, for the '
            f'random initial motion {other.condition_number:.1f}. With columns scaled to equal '
            f'length, it is {quality.scaled_condition_number:.1f}, for the random motion '
            f'{other.scaled_condition_number:.1f}. The expected standard deviations of the '
            f'parameters are {gain:.2f} times smaller than with the random motion (geometric mean).'
        )
        rows = [
            (m.limit, m.subject, float(m.reached), float(m.allowed), float(m.margin), m.unit)
            for m in self._result.report.worst_of_each()
        ]
        headings = ('limit', 'closest', 'reached', 'allowed', 'margin', 'unit')
        parts: list[str] = [table(headings, rows)]
        notes = self._result.report.notes
        if notes:
            parts += [paragraph('Clearances that are reduced or not checked:'), bullets(notes)]
        return [paragraph(lead, 'lead'), section('Limits', *parts)]

    def _trajectory(self) -> go.Figure:
        limits, names = self._setup.usable_limits, self._setup.limits.joint_names
        effort = self._setup.effort_model.effort(*self._states)
        panels = (
            ('q [rad]', self._states.q, None),
            ('dq [rad/s]', self._states.dq, limits.velocity),
            ('ddq [rad/s²]', self._states.ddq, limits.acceleration),
            ('tau [Nm]', effort, limits.effort),
        )
        figure = make_subplots(rows=4, cols=1, shared_xaxes=True, vertical_spacing=0.03)
        for row, (title, values, bound) in enumerate(panels, start=1):
            figure.update_yaxes(title_text=title, row=row, col=1)
            for j, name in enumerate(names):
                colour = _LINE_COLOURS[j % len(_LINE_COLOURS)]
                figure.add_scatter(
                    x=self._times.astype(np.float32), y=values[:, j].astype(np.float32),
                    name=name, legendgroup=name, showlegend=row == 1,
                    line={'color': colour, 'width': 1.4}, row=row, col=1,
                )  # fmt: skip
                low, high = (
                    (limits.position_min[j], limits.position_max[j])
                    if bound is None
                    else (-bound[j], bound[j])
                )
                for level in (low, high):
                    if np.isfinite(level):
                        figure.add_scatter(
                            x=self._times[[0, -1]], y=[level, level], legendgroup=name,
                            mode='lines', showlegend=False, hoverinfo='skip', row=row, col=1,
                            line={'color': colour, 'width': 0.8, 'dash': 'dash'},
                        )  # fmt: skip
        figure.update_xaxes(title_text='t [s]', row=4, col=1)
        figure.update_layout(height=900, margin={'t': 20})
        return figure

    def _path(self) -> go.Figure:
        path = self._animation.tool_path(self._states.q)
        figure = go.Figure()
        figure.add_scatter3d(
            x=path[:, 0], y=path[:, 1], z=path[:, 2], mode='lines', showlegend=False,
            line={'width': 4, 'color': self._times, 'colorscale': 'Viridis', 'showscale': True,
                  'colorbar': {'title': 't [s]', 'x': 0.0, 'xanchor': 'left', 'len': 0.7}},
        )  # fmt: skip
        figure.update_layout(scene=scene(), height=480, margin={'l': 0, 'r': 0, 't': 20, 'b': 0})
        return figure

    def _coverage(self) -> go.Figure:
        limits, names = self._setup.limits, list(self._setup.limits.joint_names)
        span = np.minimum(limits.position_max - limits.position_min, 2.0 * np.pi)
        covered = 100.0 * np.ptp(self._states.q, axis=0) / span
        figure = go.Figure()
        figure.add_bar(x=np.round(covered, 1), y=names, orientation='h', showlegend=False,
                       marker_color='#5b8fb9')  # fmt: skip
        figure.update_xaxes(title_text='covered fraction of the joint range [%]', range=[0, 100])
        figure.update_yaxes(autorange='reversed', type='category')
        figure.update_layout(height=90 + 30 * len(names), margin={'t': 10, 'b': 60})
        return figure

    def _deviations(self) -> go.Figure:
        designer = self._designer
        samples = round(1000.0 * self._result.trajectory.period)
        names = np.array(designer.regressor.columns)
        figure = go.Figure()
        for label, result in (('random start', self._reference), ('this trajectory', self._result)):
            stacked = designer.stacked(designer.states(result.trajectory))
            deviation = designer.optimality.standard_deviations(stacked, samples)
            seen = deviation > 1e-9 * deviation.max()
            figure.add_bar(name=label, x=names[seen], y=deviation[seen])
        figure.update_yaxes(
            type='log', title_text='standard deviation [SI units]', exponentformat='e', dtick=1
        )
        # Show the names of all parameters; Plotly would omit some of them by default.
        figure.update_xaxes(tickangle=90, dtick=1, tickfont={'size': 9})
        figure.update_layout(barmode='group', height=480, margin={'t': 20})
        return figure
