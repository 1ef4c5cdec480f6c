"""What the arm does: the equations of motion and all that is linear in their parameters.

In come positions, velocities and accelerations of the joints; out go frames, torques, inertia,
gravity, the regressor of the thesis, and the same of arm and carrier as one body. Pinocchio
computes; rotors, gears and friction are ours.
"""
