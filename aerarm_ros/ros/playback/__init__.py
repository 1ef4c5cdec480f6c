"""A planned motion, played on the arm.

In comes an `ExcitationPlayer`; out go its commands, once bridge, listeners and recorder are
there, and what a motor bench measures meanwhile.
"""
