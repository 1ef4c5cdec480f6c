"""The arm with the inertia boxes of its links in three dimensions, thesis figure 5.2c."""

from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.parameters.inertia_boxes import inertia_boxes
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.pages.html_text import Html
from aerarm_ros.pages.plots import figure_html, plain_text

Array = npt.NDArray[np.float64]

# Corners of the twelve triangles of a box whose corners are numbered as `corners` does, x slowest.
_TRIANGLES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)
_EYE = {'x': 2.9, 'y': 2.9, 'z': 1.0}  # far enough to see all of an upright arm
_BEFORE, _AFTER, _ARM = '#d0672b', '#0b62c4', '#1c2430'


def inertia_view(result: IdentificationResult) -> Html:
    """Return the figure: boxes of CAD and of the recommended estimate about the arm's axes.

    An estimate that no body could have is shown without boxes for the links concerned.

    Parameters
    ----------
    result : IdentificationResult
    """
    robot = result.robot
    q = result.identification[0].samples.q.mean(axis=0)
    poses = np.array([Kinematics(robot, link).transform(q) for link in robot.link_names])
    traces: list[dict[str, Any]] = [_skeleton(poses, robot.joint_names)]
    for name, inertial, colour in (
        ('before: CAD', result.cad.inertial, _BEFORE),
        ('after: sdp', result.recommended.estimate.inertial, _AFTER),
    ):
        traces += _boxes(inertial, poses, robot.link_names, name, colour)
    axes = {axis: {'title': {'text': f'{axis[0]} [m]'}} for axis in ('xaxis', 'yaxis', 'zaxis')}
    layout = {
        'height': 640,
        'margin': {'l': 0, 'r': 0, 't': 10, 'b': 0},
        'template': 'none',
        'legend': {'orientation': 'h'},
        'scene': {'aspectmode': 'data', 'camera': {'eye': _EYE}, **axes},
    }
    return figure_html('inertia-boxes', traces, layout)


def _boxes(
    inertial: Array, poses: Array, links: tuple[str, ...], name: str, colour: str
) -> list[dict[str, Any]]:
    traces: list[dict[str, Any]] = []
    corners = inertia_boxes(inertial).corners()
    for link, box, pose, parameters in zip(links, corners, poses, inertial, strict=True):
        if not np.isfinite(box).all():
            continue
        x, y, z = (box @ pose[:3, :3].T + pose[:3, 3]).round(5).T.tolist()
        i, j, k = _TRIANGLES.T.tolist()
        traces.append(
            {
                'type': 'mesh3d',
                'x': x,
                'y': y,
                'z': z,
                'i': i,
                'j': j,
                'k': k,
                'name': name,
                'legendgroup': name,
                'showlegend': not traces,
                'color': colour,
                'opacity': 0.45,
                'flatshading': True,
                'hoverinfo': 'text',
                'text': f'{plain_text(link)}, {name}<br>{parameters[0]:.4g} kg',
            }
        )
    return traces


def _skeleton(poses: Array, joints: tuple[str, ...]) -> dict[str, Any]:
    """Return the line from the base through the joints."""
    points = np.vstack([np.zeros(3), poses[:, :3, 3]]).round(5)
    x, y, z = points.T.tolist()
    return {
        'type': 'scatter3d',
        'mode': 'lines+markers',
        'x': x,
        'y': y,
        'z': z,
        'name': 'joints',
        'hoverinfo': 'text',
        'marker': {'size': 4, 'color': _ARM},
        'line': {'width': 6, 'color': _ARM},
        'text': ['base', *map(plain_text, joints)],
    }
