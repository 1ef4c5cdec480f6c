"""Report of an identification as one self-contained HTML page.

The page is composed of elements from the package `pages`.
"""
