"""What controllers are made of: a loop that answers every state, and where references come in.

In come parameters, joint states, IMU samples and messages with references; out go pure objects of
`control`, fed in one thread, and their commands. A controller derives from `ControllerNode`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'controller_node': ['ControllerNode'],
        'controller_parameters': ['ControlledArm'],
        'estimator_parameters': ['ESTIMATOR_PARAMETERS', 'estimator_settings'],
        'friction_log': ['FRICTION_LOG_PARAMETERS', 'FrictionLog'],
        'load_topics': ['LOAD_PARAMETERS', 'LoadTopics'],
        'payload_intake': ['HAND_OVER_PARAMETERS', 'PayloadIntake'],
        'plan_topic': ['PlanTopic'],
        'state_node': ['StateNode', 'state_node_parameters'],
        'target_parameters': ['TARGET_PARAMETERS', 'make_target_follower'],
        'tool_topics': ['ToolTopics'],
        'trajectory_action': ['TrajectoryAction', 'serve_trajectories'],
        'trajectory_input': ['follow_trajectory', 'go_to_set_point'],
    },
)
