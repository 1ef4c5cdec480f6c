"""Common layout of all HTML reports, each of which is one self-contained file.

A page is composed of titles, texts, tables and figures of other packages. A page is light or dark
as the reader's browser prefers, and states its origin (date, version, command) at the top.
"""
