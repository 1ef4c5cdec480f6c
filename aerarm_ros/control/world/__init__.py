"""The tool held in the world: where the base is, what the tool is to do, law, contact, reach."""
