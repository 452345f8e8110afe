"""From the camera to the world: perspective, the root trajectory and the ground plane."""
