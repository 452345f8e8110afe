"""Pose-conditioned joint-angle limits: the model, and how it is learned."""
