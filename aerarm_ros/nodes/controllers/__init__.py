"""Controllers, one executable per file; launch files and the web page list them by file name."""
