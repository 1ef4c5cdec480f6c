"""Motions from rest to rest that cost little, within every limit.

In come an arm's model with friction and payload, its limits, and where it is to go: joints or a
place of the tool; out go a motion, what it will take, and its margins in a dense check.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'motion_cost': ['MotionCost'],
        'motion_plan': ['MotionPlan'],
        'motion_planner': ['MotionPlanner'],
        'plan_error': ['PlanError'],
        'plan_settings': ['OBJECTIVES', 'PlanSettings'],
        'spline_basis': ['SplineBasis'],
        'tool_postures': ['ToolPostures'],
    },
)
