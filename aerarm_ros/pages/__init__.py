"""The look of every report: one template, one theme of plots, one file that needs no network.

In come titles, texts, tables and figures of the rooms that have something to tell; out goes a page,
light or dark as its reader likes, with what it was made of and how at its top.
"""
