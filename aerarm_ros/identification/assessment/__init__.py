"""What estimates are worth: torque errors, demands of unseen motion, plausibility, the truth.

In come estimates and the samples of every bag; out goes an `IdentificationResult`, which has
everything that files and report tell, and warnings.
"""
