"""Identification of a physically consistent dynamic model from recorded motion.

`identify.py` runs the whole identification as one function: from recordings and a URDF to parameter
estimates with their accuracy. `files` and `report` write the results. Packages import only from
packages earlier in this order: `recording`, `conditioning`, `regression`, `solvers`,
`model_choice`, `files`, `report`. Further modules define parameters (`joint_model`,
`arm_parameters`) and checks (`assessment`, `input_errors`). `motor_bench` identifies single drives.
"""
