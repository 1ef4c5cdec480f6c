"""From samples to one regression: columns that are named, triangular factors, prior and noise.

In come samples and the terms of the joints; out goes a small triangular system that any solver
can take, with its closed solution, and which combinations of parameters the motion identifies.
"""
