"""Virtual drops: the simulator flown with disturbances that an identification is not told."""
