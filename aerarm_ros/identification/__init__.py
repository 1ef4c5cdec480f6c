"""From recorded motion to a physically consistent dynamic model.

In come recordings of an arm and its URDF; out go estimates of its parameters, what they are worth,
and the files and the report that say so. `identify.py` is the door: the whole flow in one
function, timed by a `stopwatch.py` that its caller hands in. The rooms, each importing only from
those before it: `recording`, `conditioning`, `parameters`, `regression`, `rollout`,
`solvers`,
`model_choice`, `assessment`, `payload`, `files`, `report`, and `motor_bench` for drives alone.
"""
