"""The files of an identification, but for the summary, which says how long writing them took."""

from __future__ import annotations

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.files.equivalent_friction import equivalent_friction, unwritten
from aerarm_ros.identification.files.estimate_file import estimate_yaml, payload_yaml
from aerarm_ros.identification.files.identified_mjcf import identified_mjcf
from aerarm_ros.identification.files.identified_sdf import identified_sdf
from aerarm_ros.identification.files.identified_urdf import identified_urdf
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.parameters.joint_term import TermKind
from aerarm_ros.identification.report.report import ReportExtras, report_html

RESULT_FILES = (
    *('estimate.yaml', 'identified.urdf', 'identified.xml', 'identified.sdf', 'payload.yaml'),
    *('report.html', MARKER),
)
"""All that a result may hold."""


def write_result(
    result: IdentificationResult, directory: ResultDirectory, extras: ReportExtras
) -> tuple[str, ...]:
    """Write estimate, URDF, MJCF, SDF, payload and report; return what is to be said of them.

    Raises
    ------
    IdentificationError
        If something can't be written.
    """
    estimate = result.recommended.estimate
    viscous, coulomb = equivalent_friction(estimate, result.identification)
    directory.write('estimate.yaml', estimate_yaml(result, estimate, viscous, coulomb))
    load = estimate.joint_values(TermKind.LOAD.value)
    beside = equivalent_friction(estimate, result.identification, beside_load=True)
    urdf = identified_urdf(result.robot, estimate.inertial, *beside, load)
    told = (*urdf.warnings, *unwritten(estimate))
    result.warnings.extend(text for text in told if text not in result.warnings)
    directory.write('identified.urdf', urdf.text)
    rotors = estimate.joint_values(TermKind.ROTOR.value)
    values = (estimate.inertial, viscous, coulomb, rotors)
    directory.write('identified.xml', identified_mjcf(result.robot, *values))
    directory.write('identified.sdf', identified_sdf(result.robot, *values))
    if extras.payload is not None:
        directory.write('payload.yaml', payload_yaml(estimate, extras.payload))
    directory.write('report.html', report_html(result, extras))
    return told
