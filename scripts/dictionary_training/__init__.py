"""How the pose dictionaries of the paper's lifter are learned."""
