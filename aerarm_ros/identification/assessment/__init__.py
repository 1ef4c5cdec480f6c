"""What estimates are worth: torque errors, demands of unseen motion, plausibility, the truth.

In come estimates and the samples of every bag; out goes an `IdentificationResult`, which has
everything that files and report tell, and warnings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'assessment': ['BagAssessment', 'assess', 'torque_errors'],
        'bag_demand': ['BagDemand', 'extrapolation_warnings'],
        'bag_energy': ['bag_energies'],
        'identification_result': ['IdentificationResult', 'Solution'],
        'plausibility': ['bound_warnings', 'error_warnings', 'joint_warnings'],
        'residual_trend': ['ResidualTrend', 'trend_warnings'],
        'truth': ['InertialTorqueError', 'Truth', 'inertial_torque_errors', 'load_truth'],
        'verdict': ['LIMITS', 'Check', 'Verdict', 'judge', 'read_limits'],
    },
)
