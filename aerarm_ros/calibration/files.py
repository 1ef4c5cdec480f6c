"""Output files of a calibration: URDF, YAML, and the arm's configuration with offsets."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from aerarm_ros.calibration.calibrate import Calibration
from aerarm_ros.calibration.fit import Fit
from aerarm_ros.calibration.geometry import KINDS, LINK_GEOMETRY, error_transform
from aerarm_ros.calibration.observations import MarkerSource, base_pose
from aerarm_ros.description.config_reader import read_yaml, yaml_text
from aerarm_ros.description.urdf_document import numbers_text
from aerarm_ros.identification.files.identified_robot import before_root
from aerarm_ros.motion.signals import Array

_CALIBRATED = 'calibrated geometry'  # text in the first comment of a calibrated URDF
_HEADER = """\
# Calibrated geometry. SI units; each estimate is [value, standard deviation].
# offsets: added to the recorded joint positions. geometry: displacement x, y, z and rotation
# vector rx, ry, rz of a joint's frame, along the axes of the frame in the original URDF.
# compliance: deflection of a joint per gravity torque at the joint.
# All other errors are zero: they are insignificant, or the measurements cannot separate them from
# the errors listed above.
"""
_CONFIG_HEADER = (
    "# The arm's configuration with calibrated offsets. Use this file with calibrated.urdf of\n"
    '# this folder, which has no offsets. Comments of the original configuration are omitted.\n'
)


def calibrated_urdf(calibration: Calibration, with_offsets: bool) -> str:
    """Return the URDF with calibrated joint origins; all other elements stay unchanged.

    Parameters
    ----------
    with_offsets : bool
        Whether to include the joint offsets. False if the configuration of the arm contains the
        offsets.
    """
    fit = calibration.fit
    text = calibration.chain.text
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    for name, value in zip(
        fit.geometry.joint_names, fit.errors.reshape(-1, len(KINDS)), strict=True
    ):
        offset = value[0] if with_offsets else 0.0
        if not (offset or np.any(value[1:7])):
            continue
        _displace(joints[name], value, offset)
    written = ET.tostring(root, encoding='unicode').replace(' />', '/>')
    after = calibration.errors(fit)[0]
    note = (
        f'<!-- {_CALIBRATED}: {calibration.best.name}, RMS position error {1e3 * after:.3g} mm -->'
    )
    before = ''.join(line for line in before_root(text).splitlines(True) if _CALIBRATED not in line)
    return f'{before}{note}\n{written}\n'


def _displace(joint: ET.Element, value: Array, offset: float) -> None:
    origin = joint.find('origin')
    if origin is None:
        origin = ET.Element('origin')
        joint.insert(0, origin)
    place = [float(part) for part in origin.get('xyz', '0 0 0').split()]
    angles = [float(part) for part in origin.get('rpy', '0 0 0').split()]
    axis_element = joint.find('axis')
    text = '1 0 0' if axis_element is None else axis_element.get('xyz', '1 0 0')
    axis = np.array([float(part) for part in text.split()])
    axis /= np.linalg.norm(axis)
    if joint.get('type') == 'prismatic':
        shift = pin.SE3(np.eye(3), offset * axis)
    else:
        shift = pin.SE3(pin.exp3(offset * axis), np.zeros(3))
    drawn = pin.SE3(pin.rpy.rpyToMatrix(np.array(angles)), np.array(place))
    pose = drawn * error_transform(value) * shift
    origin.set('xyz', numbers_text(pose.translation))
    origin.set('rpy', numbers_text(pin.rpy.matrixToRpy(pose.rotation)))


def calibration_yaml(calibration: Calibration, offsets_in: str) -> str:
    """Return the text of calibration.yaml: estimated geometric errors and frames.

    Parameters
    ----------
    offsets_in : str
        Name of the other file that contains the offsets.
    """
    fit = calibration.fit
    document: dict[str, Any] = {
        'link': fit.geometry.link,
        'model': calibration.best.name,
        'offsets_in': offsets_in,
        'offsets': _pairs(calibration.joint_values('offset')),
        'geometry': _by_joint(calibration, LINK_GEOMETRY),
        'compliance': _pairs(calibration.joint_values('compliance')),
        'noise': {'position': float(fit.length), 'angle': float(fit.angle)},
        'frames': frames(fit),
        'as_drawn': calibration.as_drawn,
        'errors': errors_summary(calibration),
    }
    return _HEADER + yaml_text(_rounded(document))


def config_yaml(calibration: Calibration, source: Path) -> str:
    """Return the arm's configuration with the estimated offsets added to the configured offsets.

    Raises
    ------
    ConfigError
        If the file can no longer be read.
    """
    document = read_yaml(source)
    values = calibration.joint_values('offset')
    for joint in document['joints']:
        change, _ = values.get(joint['name'], (0.0, 0.0))
        if change:
            joint['offset'] = round(float(joint['offset']) + change, 7)
    return _CONFIG_HEADER + yaml_text(document)


def summary(calibration: Calibration) -> dict[str, Any]:
    """Return the results of a calibration as a dictionary, for a JSON or YAML file."""
    fit = calibration.fit
    return {
        'model': calibration.best.name,
        'link': fit.geometry.link,
        'postures': len(calibration.observations),
        'parameters': len(fit.free),
        'errors': errors_summary(calibration),
        'candidates': {
            one.name: {
                'parameters': len(one.fit.free),
                'cross_validation_mm': _mm(one.position),
                'training_mm': _mm(calibration.errors(one.fit)[0]),
                'held_out_mm': {
                    name: _mm(calibration.errors(one.fit, observations)[0])
                    for name, observations in calibration.held_out.items()
                },
            }
            for one in calibration.tried
        },
        'warnings': list(calibration.messages),
    }


def errors_summary(calibration: Calibration) -> dict[str, Any]:
    """Return RMS errors before and after calibration [mm], [mrad] by group of postures."""
    found: dict[str, Any] = {}
    for name, observations in calibration.groups.items():
        errors = np.transpose(calibration.before_after(observations)).ravel()
        keys = ('before_mm', 'after_mm', 'before_mrad', 'after_mrad')
        found[name] = {
            **dict(zip(keys, map(_mm, errors.tolist()), strict=True)),
            'markers_mm': {
                key: _mm(value) for key, value in calibration.marker_errors(observations).items()
            },
        }
    return found


def frames(fit: Fit) -> dict[str, Any]:
    """Return each sensor's pose of the arm's base, and the marker positions on the link."""
    found: dict[str, Any] = {}
    for source, state in zip(fit.observations.sources, fit.states, strict=True):
        entry: dict[str, Any] = {'base_in_sensor': _pose(*base_pose(state))}
        if isinstance(source, MarkerSource):
            places = state[12:].reshape(-1, 3)
            entry['markers_in_link'] = {
                name: place.tolist() for name, place in zip(source.names, places, strict=True)
            }
        else:
            entry['attached_in_link'] = _pose(state[12:21].reshape(3, 3), state[21:])
        found[source.name] = entry
    return found


def _pose(rotation: Array, translation: Array) -> dict[str, Any]:
    turn = Rotation.from_matrix(rotation)
    return {
        'position': translation.tolist(),
        'rpy': turn.as_euler('xyz').tolist(),
        'quaternion_xyzw': turn.as_quat().tolist(),
    }


def _by_joint(calibration: Calibration, kinds: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for kind in kinds:
        for joint, pair in calibration.joint_values(kind).items():
            found.setdefault(joint, {})[kind] = list(pair)
    return found


def _pairs(values: Mapping[str, tuple[float, float]]) -> dict[str, list[float]]:
    return {joint: list(pair) for joint, pair in values.items()}


def _mm(value: float) -> float | None:
    return round(1e3 * value, 4) if np.isfinite(value) else None


def _rounded(value: Any) -> Any:
    """Return the document with its numbers rounded to seven digits."""
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f'{value:.7g}') if isinstance(value, float) else value
