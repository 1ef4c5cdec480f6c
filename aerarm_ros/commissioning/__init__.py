"""The first power-on of an arm: which motor turns which joint, which way, by which gear, how well.

In come the bridge's reports and a person's answers; out go prompts, requests to the bridge, what
was found, and a record beside the configuration. `Commissioning` is the entry point.
"""
