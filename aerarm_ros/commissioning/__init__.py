"""Commissioning of an arm: identifies motors, joints, directions, gears and drive quality.

The inputs are the bridge's reports and a person's answers. The outputs are prompts, requests to the
bridge, findings, and a record next to the configuration. `Commissioning` is the entry point.
"""
