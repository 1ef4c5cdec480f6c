"""Controllers, one executable per file; launch files and the page offer each by its name."""
