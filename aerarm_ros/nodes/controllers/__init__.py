"""Controllers, one executable per file; launch files and the web page use the files' names."""
