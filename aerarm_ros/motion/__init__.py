"""The vocabulary of motion that control laws, excitations and the bridge share.

In come postures, velocities and times as plain numbers; out go references, states and commands
in the thesis's symbols (q, dq, ddq, tau), and the polynomials that lead from one to the next.
Nothing here knows an arm, a limit or a message.
"""
