"""What an arm carries and how its gears wear, learnt while it works.

In come states of the arm, the motion of its base and the model of the arm without a payload; out
go, fifty times a second, a body that the last link carries, with standard deviations, and friction
as it is by now.
"""
