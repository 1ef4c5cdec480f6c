"""Trajectories from which the parameters can be told best, thesis section 3.4.

In come an `ExcitationSetup` and a criterion; out goes a `DesignResult`: a feasible trajectory with
its quality, and the file that keeps both.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bounded_criterion': ['BoundedCriterion'],
        'combined_criterion': ['CombinedCriterion'],
        'condition_criterion': ['ConditionCriterion'],
        'design_constraints': ['DesignConstraints'],
        'design_criterion': ['DesignCriterion', 'information_gradient', 'information'],
        'design_file': ['write_design'],
        'design_problem': ['DesignProblem'],
        'design_result': ['Quality', 'DesignResult'],
        'design_specification': ['DesignSpecification'],
        'feasible_iterates': ['FeasibleIterates'],
        'identifiable_space': ['IdentifiableSpace'],
        'information_criterion': ['InformationCriterion'],
        'parallel_design': ['design_all'],
        'smooth_regressor': ['SmoothRegressor'],
        'state_basis': ['StateBasis'],
        'trajectory_designer': ['TrajectoryDesigner'],
        'trajectory_file': ['TrajectoryFile', 'describe_margins'],
    },
)
