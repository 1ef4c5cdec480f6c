"""Node `ground_link`, which offers the drone's topics and services on a ground computer."""
