"""Common layout of all reports: one template, one plot theme, one self-contained file.

A page is composed of titles, texts, tables and figures of other packages. It is light or dark by
the reader's preference, and states its origin at the top.
"""
