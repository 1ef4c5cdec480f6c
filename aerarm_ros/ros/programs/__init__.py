"""Implementations of the commands that read or write files.

Each of `identifier`, `calibrator`, `payload_estimator --bag`, `contact_estimator --bag`,
`excitation_designer`, `demo`, `arm calibrate` and `arm init` has a class that receives the parsed
options of the command line.
"""
