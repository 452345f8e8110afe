"""The paper's lifter: pursuit over a dictionary of poses, frame by frame."""
