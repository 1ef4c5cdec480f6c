"""From recorded motion to a physically consistent dynamic model.

In come recordings of an arm and its URDF; out go estimates of its parameters, what they are worth,
and the files and the report that say so. `identify.py` is the door: the whole flow in one
function, timed by a `stopwatch.py` that its caller hands in. The rooms, each importing only from
those before it: `recording`, `conditioning`, `parameters`, `regression`, `rollout`,
`solvers`,
`model_choice`, `assessment`, `payload`, `files`, `report`, and `motor_bench` for drives alone.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        'identify',
        'recording',
        'conditioning',
        'parameters',
        'regression',
        'rollout',
        'solvers',
        'model_choice',
        'assessment',
        'payload',
        'files',
        'report',
        'motor_bench',
    ],
    submod_attrs={
        'identify': ['IdentificationOptions'],
        'stopwatch': ['Stopwatch'],
        'recording.bag_facts': ['BagFacts'],
        'recording.desired_velocity': ['DesiredVelocity'],
        'recording.identification_error': ['IdentificationError'],
        'recording.recording': ['JointMapping', 'Recording', 'recording_from_states'],
        'conditioning.conditioning_options': ['ConditioningOptions'],
        'parameters.link_bounds': ['LinkBounds'],
        'solvers.estimate': ['Estimate'],
        'solvers.solvers': ['SOLVERS'],
        'assessment.identification_result': ['IdentificationResult', 'Solution'],
        'payload.identify_payload': ['identify_payload', 'weigh_payload'],
        'payload.payload': ['Payload'],
        'files.estimate_file': ['estimate_yaml', 'payload_yaml'],
        'files.estimate_reader': ['read_estimate'],
        'files.identified_urdf': ['identified_urdf'],
        'files.result_directory': ['ResultDirectory'],
        'files.summary': ['summarise'],
        'report.report': ['ReportExtras', 'report_html'],
        'motor_bench.motor_bench': ['KnownMass', 'MotorBench'],
        'motor_bench.motor_result': ['MotorResult'],
        'motor_bench.motor_run': ['MotorRun'],
    },
)
