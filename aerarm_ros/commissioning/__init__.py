"""Commissioning of an arm: check of motors, encoders, directions, gears and friction.

The inputs are reports of the bridge and answers of a person. The outputs are prompts for the
person, requests to the bridge, findings, and a record file next to the configuration.
`Commissioning` is the entry point.
"""
