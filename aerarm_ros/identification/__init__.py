"""Identification of a physically consistent dynamic model from recorded motion.

`identify.py` runs the whole identification as one function: from recordings and a URDF to parameter
estimates with their accuracy. `files` and `report.py` write the results. `recording` and
`conditioning` prepare the data, `regression.py` and `model_fit.py` fit a model (`joint_model.py`),
`filter_choice.py` and `model_choice.py` choose filters and friction terms, and `solvers` estimate
the parameters. `input_errors.py` searches for errors of the input. `motor_bench` identifies single
drives.
"""
