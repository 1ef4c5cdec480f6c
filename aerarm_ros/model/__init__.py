"""What the arm does: inertia, kinematics, dynamics, regressor, friction, drive train."""
