"""Pose-conditioned joint-angle limits: the model, and the nearest pose that obeys it."""
