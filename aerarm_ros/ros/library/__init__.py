"""What a program or a notebook calls: `import aerarm_ros`.

In come bags, tables or arrays, and a URDF; out go arrays of what was recorded, identified arms
that say what they are worth, and motions worth recording. `docs/reference/python.md` shows it.
"""
