"""Parts of the pages that the benchmarks write, with animations of drones and arms."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from flying.flight_record import FlightRecord
from scipy.spatial.transform import Rotation

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.resources import write_whole
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.pages.html_text import Html, origin, page
from aerarm_ros.pages.plots import figure_html, plotting_script

_THINNED = 8  # draw one in so many states


def write_page(path: Path, title: str, body: Iterable[str]) -> None:
    """Write a page and print its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, page(title, plotting_script(), body, origin()))
    print(f'Page      {path}')


def figure(
    identifier: str, traces: list[dict[str, Any]], x: str, y: str, is_log: bool = False, **more: Any
) -> Html:
    """Return a plot with its legend below; further arguments are Plotly's layout."""
    layout = {
        'height': 420,
        'margin': {'l': 60, 'r': 10, 't': 30, 'b': 90},
        'xaxis': {'title': {'text': x}},
        'yaxis': {'title': {'text': y}, 'type': 'log' if is_log else 'linear'},
        'legend': {'orientation': 'h', 'y': -0.18, 'yanchor': 'top'},  # as wide as the plot
        **more,
    }
    return figure_html(identifier, traces, layout)


def time_plot(
    identifier: str, flown: Mapping[str, Any], values: Mapping[str, np.ndarray], title: str,
    is_log: bool = False, **more: Any,
) -> Html:  # fmt: skip
    """Return a plot of values over the times of records, by the names of the records."""
    traces = [
        {
            'type': 'scatter',
            'mode': 'lines',
            'name': name,
            'x': np.round(record.times[::_THINNED], 3).tolist(),
            'y': np.round(values[name][::_THINNED], 3).tolist(),
        }
        for name, record in flown.items()
    ]
    return figure(identifier, traces, 't [s]', title, is_log, **more)


LARGER = 10.0
_PERIOD = 0.1  # [s] between frames
_COLOURS = '#3b82c4', '#d9722e'


class _Skeleton:
    """Line drawing of a drone and its arm."""

    def __init__(self, drone: DroneConfig, larger: float) -> None:
        self._larger = larger
        robot = load_robot()
        self._joints = [Kinematics(robot, link) for link in (*robot.link_names, 'tool0')]
        self._mount = np.array(drone.mount.position)
        self._turn = drone.mount.rotation
        hubs = np.array([rotor.position for rotor in drone.rotors])
        gap = np.full(3, np.nan)
        spokes = [[self._mount, hub, gap] for hub in hubs]
        self._frame = np.vstack([np.vstack(spokes), hubs, hubs[:1], gap])

    def line(self, place: np.ndarray, attitude: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return points (M, 3) in the world, with enlarged displacement and tilt."""
        arm = [np.zeros(3), *(joint.position(q) for joint in self._joints)]
        points = np.vstack([self._frame, self._mount + np.array(arm) @ self._turn.T])
        lean = Rotation.from_rotvec(self._larger * Rotation.from_quat(attitude).as_rotvec())
        known = ~np.isnan(points[:, 0])
        points[known] = lean.apply(points[known]) + self._larger * place
        return points


def replay(
    flights: Mapping[str, FlightRecord], drone: DroneConfig, larger: float = LARGER
) -> go.Figure:
    """Return an animation of several flights of one drone, drawn over each other.

    Displacements and tilts are enlarged by the factor `larger`.
    """
    skeleton = _Skeleton(drone, larger)
    end = min(record.times[-1] for record in flights.values())
    times = np.arange(-1.0, end, _PERIOD)
    frames = [
        go.Frame(
            data=[_line(skeleton, record, when, k) for k, record in enumerate(flights.values())],
            name=f'{when:.1f}',
        )
        for when in times
    ]
    figure = go.Figure(data=frames[0].data, frames=frames)
    for trace, way in zip(figure.data, flights, strict=True):
        trace.name = way
    axis = {'range': [-1.0, 1.0], 'title': ''}
    figure.update_layout(
        scene={'xaxis': axis, 'yaxis': axis, 'zaxis': axis, 'aspectmode': 'cube'},
        height=640,
        margin={'l': 0, 'r': 20, 't': 20, 'b': 120},
        **_playback([frame.name for frame in frames], round(1e3 * _PERIOD)),
    )
    return figure


def _line(skeleton: _Skeleton, record: FlightRecord, when: float, number: int) -> go.Scatter3d:
    k = min(int(np.searchsorted(record.times, when)), len(record.times) - 1)
    points = skeleton.line(record.places[k], record.attitudes[k], record.postures[k])
    x, y, z = np.round(points, 4).astype(np.float32).T
    colour = _COLOURS[number % len(_COLOURS)]
    return go.Scatter3d(x=x, y=y, z=z, mode='lines', line={'width': 6, 'color': colour})


def _playback(names: list[str], milliseconds: int) -> dict[str, object]:
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
