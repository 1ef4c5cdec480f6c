"""One executable a file: parameters -> pure object -> topics."""
