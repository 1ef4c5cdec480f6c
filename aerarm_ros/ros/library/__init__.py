"""Functions for programs and notebooks: `import aerarm_ros`.

The inputs are bags, tables or arrays, and a URDF. The results are arrays of recorded motion,
identified arms with error estimates, and excitation trajectories. `docs/reference/python.md` has
examples.
"""
