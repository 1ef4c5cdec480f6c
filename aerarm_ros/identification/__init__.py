"""Identification of a physically consistent dynamic model from recorded motion.

`identify.py` runs the whole identification as one function: from recordings and a URDF to parameter
estimates with their accuracy. `files` and `report` write the results. Packages import only from
packages earlier in this order: `recording`, `conditioning`, `regression`, `rollout`, `solvers`,
`model_choice`, `assessment`, `payload`, `files`, `report`. `motor_bench` identifies single drives.
"""
