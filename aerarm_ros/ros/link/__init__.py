"""`ground_link`: offer the drone's topics and services on the ground over one connection."""
