"""Elements and layout of the HTML reports.

A report is one self-contained file. It has a light and a dark layout, between which the browser
selects. At the top it states date, version and command line of its origin.
"""
