"""A result as one HTML page that needs nothing else to be read.

In come an identification's result and what is known besides; out goes the page, made of the pieces
that `pages` has for all.
"""
